"""Cycles bakes the same pages: same GLB, same UVs, same judge; then what it would need for Lumel's error."""

import json
import math
import os

from benches import bakes, process
from environment import ROOT, python_of

# Paths a texel, and the light that a GLB can't tell of.
CYCLES = {
    "reference cornell_box": ([16, 64, 256], []),
    "reference living_room": ([4, 16, 64], []),
    "reference atrium": ([16, 64], ["--sky", "0.45,0.62,1.0", "--sun-angle", "0.53"]),
}
ERROR = "rel_rmse_trim1"


def measure(ours: list[dict], samples: list[int] | None, more: list[str]) -> list[dict]:
    """Cycles beside the bakes `ours` of reference scenes, which lie in their folders."""
    if not python_of("blender").exists():
        print("\nCycles: skipped, Blender's module is absent: `tools/test --setup` installs it")
        return []
    results = []
    for scene in bakes.REFERENCES:
        mine = [r for r in ours if r["name"].startswith(scene.name)]
        if not mine:
            continue
        glb = ROOT / mine[-1]["folder"] / f"{scene.path.stem}.glb"
        counts, light = CYCLES[scene.name]
        for count in samples or counts:
            folder = bakes.WORK / f"cycles_{scene.path.parent.name}_{count}"
            result = bake(glb, folder, count, [*light, *more])
            if result is None:
                break
            result = {"name": f"{scene.name} Cycles {count}", "scene": scene.name, "samples": count, **result}
            result["judged"] = bakes.judge(folder / glb.name, scene.points)
            show(result)
            results.append(result)
        for line in ratio_lines(mine, [r for r in results if r["scene"] == scene.name]):
            print(line, flush=True)
    return results


def bake(glb, folder, samples: int, more: list[str]) -> dict | None:
    """Cycles' pages for `glb`; none, with a line, where Blender fails."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "DISPLAY")}
    script = ROOT / "tools/blender/bake_pages.py"
    used = process.run([python_of("blender"), script, glb, folder, samples, *more], env)
    lines = [line for line in used.stdout.splitlines() if line.startswith("{")]
    if used.status != 0 or not lines:
        print(f"\nCycles: skipped, Blender failed: {(used.stderr or used.stdout)[-1000:]}")
        return None
    return {"wall_s": used.wall_s, "cpu_s": used.cpu_s, "peak_bytes": used.peak_bytes, **json.loads(lines[-1])}


def show(r: dict) -> None:
    print(
        f"\n{r['name']} paths a texel: {r['cpu_s']:.2f} s CPU ({r['bake_cpu_s']:.2f} in the bake call), {r['wall_s']:.2f} s wall, "
        f"{r['peak_bytes'] / 2**20:.0f} MiB"
    )
    if r["judged"]:
        print("    found        " + bakes.judged_line(r["judged"]))


def time_at(error: float, curve: list[tuple[float, float]]) -> tuple[float, bool]:
    """CPU time at an error, along a curve of (time, error) in log-log; beyond its ends the error falls as the root of time does.

    The second value says whether that is so.
    """
    curve = sorted(curve)
    for (t0, e0), (t1, e1) in zip(curve, curve[1:]):
        if min(e0, e1) <= error <= max(e0, e1) and e0 != e1:
            share = math.log(error / e0) / math.log(e1 / e0)
            return t0 * (t1 / t0) ** share, False
    t, e = min(curve, key=lambda point: abs(math.log(error / point[1])))
    return t * (e / error) ** 2, True


def ratios(ours: list[dict], theirs: list[dict]) -> list[dict]:
    """For each bake of ours: CPU time that Cycles needs for its error, over ours; loading and unwrapping on neither side."""
    curve = [(r["bake_cpu_s"], r["judged"][ERROR]) for r in theirs if r["judged"]]
    found = []
    for r in ours:
        if curve and r["judged"]:
            needed, is_extrapolated = time_at(r["judged"][ERROR], curve)
            found.append({"name": r["name"], "needed_s": needed, "ratio": needed / r["bake_cpu_s"], "is_extrapolated": is_extrapolated})
    return found


def ratio_lines(ours: list[dict], theirs: list[dict]) -> list[str]:
    found = {r["name"]: r for r in ours}
    return [
        f"{r['name']}: at the same error ({ERROR} {100 * found[r['name']]['judged'][ERROR]:.2f} %) Cycles needs {r['ratio']:.0f} times the CPU time"
        + (f" ({r['needed_s']:.0f} s: beyond what was measured, error as time to the power of -1/2)" if r["is_extrapolated"] else "")
        for r in ratios(ours, theirs)
    ]
