"""PNG with a palette, stored without compression: the bytes don't depend on a version of zlib."""

import struct
import zlib


def paletted(width: int, rows: list[bytes], palette: list[tuple[int, int, int]]) -> bytes:
    """The file for `rows` of palette indices."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    raw = b"".join(b"\0" + row for row in rows)
    blocks = [raw[i : i + 65535] for i in range(0, len(raw), 65535)]
    stream = b"\x78\x01"
    for i, block in enumerate(blocks):
        stream += struct.pack("<BHH", i == len(blocks) - 1, len(block), len(block) ^ 0xFFFF) + block
    stream += struct.pack(">I", zlib.adler32(raw))
    header = struct.pack(">IIBBBBB", width, len(rows), 8, 3, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"PLTE", bytes(v for color in palette for v in color))
        + chunk(b"IDAT", stream)
        + chunk(b"IEND", b"")
    )
