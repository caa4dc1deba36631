"""One scene at growing numbers of texels, and on one thread and two."""

import hashlib
import math
from pathlib import Path

from benches import bakes
from benches.solvers import exponent
from environment import ROOT

SCENE = ROOT / "samples/cornell_box/cornell_box.glb"
SIZES = [16, 18, 20, 22]
FULL = [*SIZES, 24]
ERROR = "2%"
# Density is chosen after a bake of this many texels a side.
PROBE = "256"
KEPT = ("cpu_s", "bake_cpu_s", "wall_s", "peak_bytes", "bytes_per_texel", "texels", "rays", "estimate")


def measure(full: bool, repeat: int) -> list[dict]:
    settings = ["--error", ERROR, "--gltf", "engine"]
    probe = bakes.bake(SCENE, [*settings, "--resolution", PROBE], bakes.WORK / "scale")
    scene_bytes = bakes.bake(SCENE, [*settings, "--resolution", bakes.SMALL], bakes.WORK / "scale")["process"]["peak_bytes"]
    rows = []
    for power in FULL if full else SIZES:
        density = probe["density"] * math.sqrt(2**power / probe["texels"])
        page = 4096 if power > 22 else 2048
        row = {"name": f"2^{power}", "page_size": page, "threads": []}
        digests = set()
        for threads in (1, 2):
            folder = bakes.WORK / f"scale_{power}_{threads}"
            more = ["--density", f"{density:.6g}", "--page-size", str(page), "--threads", str(threads)]
            report = bakes.bake(SCENE, settings + more, folder, repeat)
            digests.add(digest(folder))
            figures = bakes.figures(f"2^{power}, {threads} thread(s)", more, report, scene_bytes)
            row["threads"].append({k: figures[k] for k in KEPT})
        row["is_equal"] = len(digests) == 1
        rows.append(row)
        show(row)
    print(f"CPU time grows as the number of texels to the power of {growth(rows):.2f}")
    return rows


def growth(rows: list[dict]) -> float:
    """The power of the number of texels that CPU time grows by, on two threads."""
    two = [r["threads"][1] for r in rows]
    return exponent([r["texels"] for r in two], [r["bake_cpu_s"] for r in two])


def digest(folder: Path) -> str:
    """Of all pages."""
    sha = hashlib.sha256()
    for page in sorted((folder / "lightmaps").glob("*.exr")):
        sha.update(page.read_bytes())
    return sha.hexdigest()


def show(row: dict) -> None:
    one, two = row["threads"]
    print(
        f"{row['name']}: {two['texels']:,} texels, {two['bake_cpu_s']:.2f} s CPU, {two['bake_cpu_s'] / two['texels'] * 1e6:.2f} us a texel, "
        f"{two['peak_bytes'] / 2**20:.0f} MiB, {two['bytes_per_texel']:.0f} bytes a texel above the scene; "
        f"one thread {one['wall_s']:.2f} s, two {two['wall_s']:.2f} s: {one['wall_s'] / two['wall_s']:.2f} times, "
        f"pages {'equal' if row['is_equal'] else 'DIFFER'}; estimated error {two['estimate']['estimated']:.2f} %",
        flush=True,
    )
