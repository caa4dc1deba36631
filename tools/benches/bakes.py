"""Whole bakes: the samples, and the reference scenes with the error that they are found to have."""

import json
import os
import shutil
import sys
from dataclasses import dataclass, field
from pathlib import Path

from benches import process
from environment import ROOT, python_of

REFERENCE = Path(os.environ.get("LUMEL_REFERENCE", ROOT.parent / "shared"))
# Bakes are kept here until the next run: peers are baked into the same layout.
WORK = ROOT / "target/bench"
# A bake this small holds the scene and next to no texels [texels a side].
SMALL = "64"
# Of the judge's figures those that are kept.
JUDGED = ("bias", "bias5", "rel_rmse_trim1", "p50", "p95", "unmapped")
# Stages that a peer's bake doesn't have: it begins with a scene and its UVs in memory.
BEFORE = ("load", "unwrap")


@dataclass
class Scene:
    """A scene and how it is baked; `errors` are those it is asked for [%], none: the default."""

    name: str
    path: Path
    settings: list[str]
    errors: list[float | None] = field(default_factory=lambda: [None])
    points: Path | None = None

    def runs(self) -> list[tuple[str, list[str]]]:
        """Name and settings of each bake."""
        asked = [(f"{self.name} {e:g} %", ["--error", f"{e:g}%"]) if e else (self.name, []) for e in self.errors]
        return [(name, self.settings + more) for name, more in asked]


def reference(name: str, file: str, settings: list[str], errors: list[float]) -> Scene:
    folder = REFERENCE / "reference" / name
    # The reference values are about geometric normals.
    return Scene(f"reference {name}", folder / file, [*settings, "--normals", "geometric"], errors, folder / "points.npz")


def sample(name: str, file: str, settings: list[str]) -> Scene:
    return Scene(name, ROOT / "samples" / name / file, settings)


REFERENCES = [
    reference("cornell_box", "scene.glb", ["--resolution", "256"], [5, 2, 0.6]),
    reference("living_room", "scene.glb", ["--resolution", "1024"], [5, 1.5]),
    reference("atrium", "scene.usdc", ["--resolution", "1024", "--uv", "keep"], [5, 3]),
]
SAMPLES = [
    sample("cornell_box", "cornell_box.glb", ["--resolution", "256"]),
    sample("furnace", "furnace.glb", ["--resolution", "128"]),
    sample("sunroom", "sunroom.usda", []),
]


def bake(scene: Path, settings: list[str], folder: Path, repeat: int = 1) -> dict:
    """Bakes `repeat` times; the report of the quickest, with what its process took (`process`)."""
    best = None
    for _ in range(repeat):
        shutil.rmtree(folder, ignore_errors=True)
        used = process.run([process.program(), "bake", scene, "-o", folder, *settings])
        if used.status != 0:
            sys.exit(f"bench: {scene}: exit {used.status}\n{used.stderr[-2000:]}")
        report = json.loads((folder / "report.json").read_text())
        report["process"] = {"wall_s": used.wall_s, "cpu_s": used.cpu_s, "peak_bytes": report["peak_memory_bytes"] or used.peak_bytes}
        if best is None or used.cpu_s < best["process"]["cpu_s"]:
            best = report
    return best


def judge(glb: Path, points: Path | None) -> dict | None:
    """Figures of the reference folder's tool, none where it can't run."""
    tool = REFERENCE / "tools/lightmap_error.py"
    if not (points and tool.is_file() and points.is_file() and python_of("checks").exists()):
        return None
    run = process.run([python_of("checks"), tool, glb, points, "--json"])
    if run.status != 0:
        print(f"bench: {tool.name} failed: {run.stderr[-500:]}")
        return None
    found = json.loads(run.stdout)
    return {k: found[k] for k in JUDGED}


def measure(scene: Scene, more: list[str], repeat: int) -> list[dict]:
    """Bakes a scene at each error it is asked for, and prints a table of each bake."""
    if not scene.path.is_file():
        print(f"\n{scene.name}: skipped, {scene.path} is absent")
        return []
    small = scene.settings.copy()
    if "--resolution" in small:
        small[small.index("--resolution") + 1] = SMALL
    else:
        small += ["--resolution", SMALL]
    scene_bytes = bake(scene.path, [*small, "--error", "20%", *more], WORK / "small")["process"]["peak_bytes"]
    results = []
    for name, settings in scene.runs():
        folder = WORK / name.replace(" %", "").replace(" ", "_")
        report = bake(scene.path, settings + more, folder, repeat)
        result = figures(name, settings + more, report, scene_bytes)
        result["judged"] = judge(folder / f"{scene.path.stem}.glb", scene.points)
        result["folder"] = str(folder.relative_to(ROOT))
        print(table(result), flush=True)
        results.append(result)
    return results


def figures(name: str, settings: list[str], report: dict, scene_bytes: int) -> dict:
    """What is kept of a bake."""
    took, stages, texels = report["process"], report["stages"], report["texels"]
    return {
        "name": name,
        "settings": settings,
        "wall_s": took["wall_s"],
        "cpu_s": took["cpu_s"],
        "bake_cpu_s": sum(s["cpu_s"] for s in stages if s["name"] not in BEFORE),
        "stages": [{k: s[k] for k in ("name", "wall_s", "cpu_s")} for s in stages],
        "texels": texels,
        "rays": report["rays"],
        "peak_bytes": took["peak_bytes"],
        "bytes_per_texel": max(took["peak_bytes"] - scene_bytes, 0) / max(texels, 1),
        "estimate": report.get("error"),
    }


def table(r: dict) -> str:
    lines = [
        f"\n{r['name']}: {r['cpu_s']:.2f} s CPU ({r['bake_cpu_s']:.2f} without loading and unwrapping), {r['wall_s']:.2f} s wall, "
        f"{r['texels'] / 1e3:.0f} k texels, {r['rays'] / 1e6:.1f} M rays, {r['rays'] / max(r['bake_cpu_s'], 1e-9) / 1e6:.2f} M a CPU second, "
        f"{r['peak_bytes'] / 2**20:.0f} MiB, {r['bytes_per_texel']:.0f} bytes a texel above the scene"
    ]
    lines += [f"    {s['name']:<12} {s['wall_s']:8.2f} s wall {s['cpu_s']:8.2f} s CPU" for s in r["stages"]]
    if r["estimate"]:
        lines.append("    estimated    " + "  ".join(f"{k} {r['estimate'][k]:.2f} %" for k in ("aimed", "estimated", "noise", "bias")))
    if r["judged"]:
        lines.append("    found        " + judged_line(r["judged"]))
    return "\n".join(lines)


def judged_line(judged: dict) -> str:
    return "  ".join(f"{k} {100 * judged[k]:.2f} %" for k in JUDGED)
