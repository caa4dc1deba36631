"""Writes the page of results, and the table of the README, from the figures that `--json` kept."""

import json
import re
from pathlib import Path

from benches import peers, scale
from environment import ROOT

FOLDER = ROOT / "samples/studies/speed"
FIGURES = FOLDER / "figures.json"
# Where the README's table stands.
HEADING = "## How good, how fast"
# Digits that figures are kept with.
DIGITS = 4


def keep(measured: dict, file: Path) -> None:
    """Adds figures to `file`, a line for each bake; those of other bakes that it holds stay."""
    kept = json.loads(file.read_text()) if file.is_file() else {}
    for kind, new in measured.items():
        names = {row["name"] for row in new["figures"]}
        old = [row for row in kept.get(kind, {"figures": []})["figures"] if row["name"] not in names]
        kept[kind] = {"machine": new["machine"], "figures": old + new["figures"]}
    kinds = []
    for kind, held in kept.items():
        rows = ",\n  ".join(json.dumps(rounded(row)) for row in held["figures"])
        kinds.append(f' "{kind}": {{ "machine": {json.dumps(held["machine"])}, "figures": [\n  {rows}\n ] }}')
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("{\n" + ",\n".join(kinds) + "\n}\n")


def rounded(value):
    """Floats to DIGITS significant digits, at any depth."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def write() -> None:
    if not FIGURES.is_file():
        raise SystemExit(f"bench: {FIGURES.relative_to(ROOT)} is absent: measure with --json first")
    kept = json.loads(FIGURES.read_text())
    (FOLDER / "README.md").write_text(text(kept))
    readme = ROOT / "README.md"
    head, section = readme.read_text().split(HEADING, 1)
    readme.write_text(head + HEADING + re.sub(r"\n\|(.*\n\|)*.*\n", lambda _: "\n" + headline(kept), section, count=1))


def judged(kept: dict) -> list[dict]:
    return [r for r in kept["bakes"]["figures"] if r["judged"]]


def rows_of(rows: list[list[str]]) -> str:
    """A Markdown table; the first row is its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]]) + "\n"


def ratios(kept: dict) -> dict[str, str]:
    """What Cycles needs at the error of each bake, as shown: times our CPU time."""
    shown = {}
    theirs = kept.get("peers", {"figures": []})["figures"]
    for scene in {r["scene"] for r in theirs}:
        ours = [r for r in judged(kept) if r["name"].startswith(scene)]
        for r in peers.ratios(ours, [t for t in theirs if t["scene"] == scene]):
            shown[r["name"]] = f"{two_digits(r['ratio'])} x" + (" *" if r["is_extrapolated"] else "")
    return shown


def headline(kept: dict) -> str:
    """The README's table."""
    rows = [["scene", "setting", "CPU time", "time", "bias", "median error", "Cycles needs"]]
    cycles = ratios(kept)
    for r in judged(kept):
        rows.append([
            f"{title(r)}, {r['texels'] / 1e3:,.0f} k texels",
            f"`--error {asked(r)}`",
            f"{seconds(r['bake_cpu_s'])} s",
            f"{seconds(r['wall_s'])} s",
            f"{100 * r['judged']['bias']:+.1f} %",
            f"{100 * r['judged']['p50']:.1f} %",
            cycles.get(r["name"], "-"),
        ])
    return rows_of(rows)


def title(r: dict) -> str:
    return r["name"].removeprefix("reference ").rsplit(" ", 2)[0].replace("cornell_box", "Cornell box").replace("_", " ")


def asked(r: dict) -> str:
    return r["settings"][r["settings"].index("--error") + 1]


def seconds(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def percent(value: float) -> str:
    """A share as per cent."""
    return f"{100 * value:.2f}" if abs(value) < 0.1 else f"{100 * value:.1f}"


def text(kept: dict) -> str:
    machine = kept["bakes"]["machine"]
    parts = [
        "# Speed\n",
        f"Measured by `tools/bench --peers --scale` on {machine['processor']}, {machine['cores']} cores, {machine['instructions']}; "
        f"{machine['lumel']}, {machine['rustc']}; {machine['date']}.\n"
        "`tools/bench --page` writes this page from [figures.json](figures.json).\n",
        "## Reference scenes\n",
        bakes_table(kept),
        "CPU time is that of all threads, in brackets without loading and unwrapping; memory per texel is what the bake holds above one\n"
        "of the same scene at 64 x 64. *Estimated* is the report's own estimate, against the area average of each texel. *Found* is the\n"
        "RMS of the difference over the mean, on luminance, against converged path-traced values at points, without the worst 1 % of\n"
        "them; it reads pages bilinearly, as an engine does, so the size of the texels counts. bias5 is over points below 5 times the\n"
        "mean: a few sunlit ones rule the plain bias. p50 and p95 are relative to each value.\n",
    ]
    if "peers" in kept and kept["peers"]["figures"]:
        version = kept["peers"]["figures"][0]["version"]
        parts += [
            "## Beside Cycles\n",
            cycles_table(kept),
            f"Blender {version} bakes the same pages: 64 bounces, nothing clamped, no denoising, diffuse materials, margin of 2 texels; same\n"
            "UVs, same judge. The bake call alone is compared. The last column above is the CPU time it needs for the error found, over\n"
            "ours, between its runs along a line in log-log; * beyond them, where its error is taken to fall as the root of time.\n",
        ]
    if "scale" in kept:
        rows = kept["scale"]["figures"]
        parts += [
            "## Against size\n",
            scale_table(rows),
            f"The sample Cornell box at `--error {scale.ERROR}`. CPU time, without loading and unwrapping, grows as the number of texels to the\n"
            f"power of {scale.growth(rows):.2f} ({scale.growth(rows[-2:]):.2f} over the last step). Pages are the same bytes on one thread and two{'' if all(r['is_equal'] for r in rows) else ': NOT HERE'}.\n",
        ]
    return "\n".join(parts)


def bakes_table(kept: dict) -> str:
    rows = [["scene", "`--error`", "texels", "CPU s", "wall s", "M rays", "MiB", "bytes a texel", "estimated %", "found %", "bias %", "bias5 %", "p50 %", "p95 %", "Cycles needs"]]
    cycles = ratios(kept)
    for r in judged(kept):
        found = r["judged"]
        rows.append([
            title(r),
            asked(r),
            f"{r['texels'] / 1e3:,.0f} k",
            f"{seconds(r['cpu_s'])} ({seconds(r['bake_cpu_s'])})",
            seconds(r["wall_s"]),
            f"{r['rays'] / 1e6:.1f}",
            f"{r['peak_bytes'] / 2**20:.0f}",
            f"{r['bytes_per_texel']:.0f}",
            f"{r['estimate']['estimated']:.2f}",
            percent(found["rel_rmse_trim1"]),
            f"{100 * found['bias']:+.2f}",
            f"{100 * found['bias5']:+.2f}",
            percent(found["p50"]),
            percent(found["p95"]),
            cycles.get(r["name"], "-"),
        ])
    return rows_of(rows)


def cycles_table(kept: dict) -> str:
    rows = [["scene", "paths a texel", "CPU s", "found %", "bias %", "p50 %", "p95 %", "MiB"]]
    for r in kept["peers"]["figures"]:
        found = r["judged"]
        rows.append([
            r["scene"].removeprefix("reference ").replace("cornell_box", "Cornell box").replace("_", " "),
            f"{r['samples']}",
            f"{seconds(r['cpu_s'])} ({seconds(r['bake_cpu_s'])})",
            percent(found["rel_rmse_trim1"]),
            f"{100 * found['bias']:+.2f}",
            percent(found["p50"]),
            percent(found["p95"]),
            f"{r['peak_bytes'] / 2**20:.0f}",
        ])
    return rows_of(rows)


def scale_table(rows: list[dict]) -> str:
    table = [["texels", "CPU s", "us a texel", "MiB", "bytes a texel", "one thread, wall s", "two", "ratio", "estimated %"]]
    for r in rows:
        one, two = r["threads"]
        table.append([
            f"{two['texels']:,}",
            seconds(two["bake_cpu_s"]),
            f"{1e6 * two['bake_cpu_s'] / two['texels']:.1f}",
            f"{two['peak_bytes'] / 2**20:.0f}",
            f"{two['bytes_per_texel']:.0f}",
            seconds(one["wall_s"]),
            seconds(two["wall_s"]),
            f"{one['wall_s'] / two['wall_s']:.2f}",
            f"{two['estimate']['estimated']:.2f}",
        ])
    return rows_of(table)
