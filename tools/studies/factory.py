"""The factory of 1988: 30,000 patches, 2,000 shots."""

from dataclasses import dataclass

from .scenes import factory
from .workbench import Bake, Workbench, page_error, reference_text, shown, significant, table


@dataclass
class Size:
    """Texels a metre (each is a patch), shots, and how often to look; the reference's samples."""

    density: float
    shots: int
    every: int
    samples: int


FULL = Size(2.9, 2000, 500, 1024)
LIGHT = Size(0.5, 200, 100, 64)


def shots(bench: Workbench, size: Size, *options) -> Bake:
    scene = bench.work / "factory.glb"
    arguments = ["--quality", "draft", "--density", size.density, "--elements", 100_000, "--gather", "none"]
    arguments += ["--solver", "progressive", "--iterations", size.shots, *options]
    return bench.bake(scene, *arguments, watch_every=size.every)


def links(bench: Workbench, size: Size) -> Bake:
    """The same patches by links between clusters of them, until nothing changes."""
    arguments = ["--quality", "draft", "--density", size.density, "--elements", 100_000, "--gather", "none"]
    return bench.bake(bench.work / "factory.glb", *arguments, "--solver", "hierarchical")


def reference(bench: Workbench, size: Size) -> Bake:
    return bench.reference(bench.work / "factory.glb", size.density, size.samples)


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    bench.write(factory.scene())
    truth = reference(bench, size).pages()
    plain, ambient = shots(bench, size), shots(bench, size, "--ambient")
    linked = links(bench, size)
    steps = {}
    for step in range(size.every, size.shots + 1, size.every):
        steps[f"{step}"] = {
            "plain": page_error(plain.pages(step), truth),
            "ambient": page_error(ambient.pages(step), truth),
        }
    numbers = {
        "reference_bias": bench.reference_bias(bench.work / "factory.glb", size.density, size.samples),
        "triangles": plain.report["triangles"],
        "patches": plain.solver["elements"],
        "shots": plain.solver["iterations"],
        "unshot_share": significant(plain.solver["unshot"] / plain.solver["steps"][0]["unshot"]),
        "by_step": steps,
        "hierarchical": page_error(linked.pages(), truth),
    }
    return numbers, {"shots": plain.seconds("solve"), "hierarchical": linked.seconds("solve"), "all": significant(sum(s["wall_s"] for s in plain.report["stages"]), 3)}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    truth = reference(bench, size)
    plain, ambient = shots(bench, size), shots(bench, size, "--ambient")
    exposure = bench.picture("reference", truth)
    bench.picture("shots", plain, exposure=exposure)
    bench.picture("ambient", ambient, exposure=exposure)
    bench.picture("patches", ambient, exposure=exposure, flat=True)
    rows = [[n, r["plain"]["rms"], r["plain"]["bias"], r["ambient"]["rms"], r["ambient"]["bias"]] for n, r in numbers["by_step"].items()]
    whole = numbers["hierarchical"]
    head = ["shots", "RMS", "bias", "RMS, ambient term", "bias, ambient term"]
    return f"""# The factory

| after {numbers["shots"]} shots | with the ambient term |
|---|---|
| {shown("shots", "2000 shots")} | {shown("ambient", "2000 shots with the ambient term")} |

| its patches | reference |
|---|---|
| {shown("patches", "flat patches")} | {shown("reference", "reference")} |

Cohen, Chen, Wallace and Greenberg, "A Progressive Refinement Approach to Fast Radiosity Image Generation" (SIGGRAPH 1988), showed
a factory of 30,000 patches after 2,000 shots; that took about five hours on a VAX 8700.

**Scene.** A procedural hall of 16 x 36 m: {numbers["triangles"]} triangles, machines, a conveyor, trusses, a crane, 14 lamps that shine
downwards only. Every texel is a patch: {numbers["patches"]} of them.

    lumel bake factory.glb --quality draft --density {size.density:g} --elements 100000 --gather none --solver progressive --iterations {size.shots}

**Time.** {numbers["shots"]} shots: **{measured["shots"]["wall"]:.0f} s**, {measured["shots"]["cpu"]:.0f} s of CPU time
({measured["cores"]} cores that other work shared, {measured["date"]}); five hours are 18,000 s.

**Error** against the reference ({reference_text(numbers)}), RMS over the mean and bias, per cent:

{table(head, rows)}
After {numbers["shots"]} shots {100 * numbers["unshot_share"]:.0f} % of the light that the lamps made the surfaces reflect is still unshot: most
patches have never had their turn, and the roof, which sees no lamp, shows it. The ambient term stands in for that light. The rest
of the error is the size of the patches, 0.34 m: trusses and shadows are thinner.

`--solver hierarchical` links clusters of the same patches, and takes **{measured["hierarchical"]["wall"]:.1f} s**
({measured["hierarchical"]["cpu"]:.1f} s of CPU time) until nothing changes: RMS {whole["rms"]:g} %, bias {whole["bias"]:g} %.
"""
