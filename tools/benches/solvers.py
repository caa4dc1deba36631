"""The solvers alone: shots in the factory beside the hierarchical solver, and the latter against size."""

import math
import tempfile
from pathlib import Path

from benches import bakes
from environment import ROOT
from sample_scenes import glb
from studies.scenes import factory


def exponent(sizes: list[float], times: list[float]) -> float:
    """The power of size that time grows by: the slope of a line through the logarithms."""
    n, t = [math.log(s) for s in sizes], [math.log(s) for s in times]
    mean_n, mean_t = sum(n) / len(n), sum(t) / len(t)
    return sum((a - mean_n) * (b - mean_t) for a, b in zip(n, t)) / sum((a - mean_n) ** 2 for a in n)


def solve(scene: Path, settings: list[str]) -> dict:
    """Size, time and outcome of a solve in which every texel is an element."""
    flat = ["--quality", "draft", "--elements", "4000000", "--gather", "none", "--gltf", "engine"]
    report = bakes.bake(scene, flat + settings, bakes.WORK / "solve")
    solver = {k: v for k, v in report["solver"].items() if k != "steps"}
    time = next(s for s in report["stages"] if s["name"] == "solve")
    return {"settings": settings, "wall_s": time["wall_s"], "cpu_s": time["cpu_s"], **solver}


def measure(more: list[str]) -> list[dict]:
    results = []

    def show(name: str, result: dict) -> None:
        left = f"residual {result['residual']:.2%}" if result["residual"] < 1 else "far from converged"
        print(
            f"{name:<34} {result['elements']:>9,} elements {result['wall_s']:8.2f} s wall {result['cpu_s']:8.2f} s CPU, "
            f"{result['iterations']} iterations, {left}",
            flush=True,
        )
        results.append({"name": name, **result})

    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "factory.glb"
        glb.write(factory.scene(), scene)
        show("factory, 2,000 shots", solve(scene, ["--density", "2.9", "--solver", "progressive", "--iterations", "2000", *more]))
        show("factory, hierarchical", solve(scene, ["--density", "2.9", "--solver", "hierarchical", *more]))
    sizes = []
    for resolution in (165, 330, 660, 1320):
        scene = ROOT / "samples/cornell_box/cornell_box.glb"
        result = solve(scene, ["--resolution", str(resolution), "--solver", "hierarchical", *more])
        show(f"Cornell box {resolution}, hierarchical", result)
        sizes.append(result)
    slope = exponent([r["elements"] for r in sizes], [r["wall_s"] for r in sizes])
    print(f"time grows as the number of elements to the power of {slope:.2f}")
    return [*results, {"name": "hierarchical exponent", "exponent": slope}]
