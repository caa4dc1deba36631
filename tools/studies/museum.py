"""The museum of 1988: light over ceiling baffles, the solution watched while it grows."""

from dataclasses import dataclass

from .scenes import museum
from .workbench import Bake, Workbench, page_error, reference_text, shown, significant, table


@dataclass
class Size:
    """Texels a metre, elements, shots and how often to look, the shots that are shown; the reference's samples."""

    density: float
    elements: int
    shots: int
    every: int
    shown: tuple[int, ...]
    samples: int


FULL = Size(7.0, 4000, 6400, 100, (100, 400, 1600, 6400), 1024)
LIGHT = Size(2.0, 400, 400, 50, (50, 100, 400), 64)


def watched(bench: Workbench, size: Size, *options) -> Bake:
    scene = bench.work / "museum.glb"
    arguments = ["--density", size.density, "--elements", size.elements, "--gather", "none", "--solver", "progressive"]
    return bench.bake(scene, *arguments, "--iterations", size.shots, *options, watch_every=size.every)


def reference(bench: Workbench, size: Size) -> Bake:
    return bench.reference(bench.work / "museum.glb", size.density, size.samples)


def direct(bench: Workbench, size: Size) -> Bake:
    return bench.bake(bench.work / "museum.glb", "--density", size.density, "--max-bounces", 0)


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    bench.write(museum.scene())
    truth = reference(bench, size).pages()
    plain, ambient = watched(bench, size), watched(bench, size, "--ambient")
    steps = {
        f"{step}": {"plain": page_error(plain.pages(step), truth), "ambient": page_error(ambient.pages(step), truth)}
        for step in size.shown
    }
    share = 100 + page_error(direct(bench, size).pages(), truth)["bias"]
    numbers = {
        "reference_bias": bench.reference_bias(bench.work / "museum.glb", size.density, size.samples),
        "elements": plain.solver["elements"],
        "direct_percent": significant(share),
        "by_step": steps,
    }
    return numbers, {"shots": plain.seconds("solve")}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    truth = reference(bench, size)
    plain, ambient = watched(bench, size), watched(bench, size, "--ambient")
    small = (240, 180)
    exposure = bench.picture("reference", truth)
    bench.picture("direct", direct(bench, size), small, exposure=exposure)
    for step in size.shown:
        bench.picture(f"plain_{step}", plain, small, exposure=exposure, step=step)
        bench.picture(f"ambient_{step}", ambient, small, exposure=exposure, step=step)
    gallery = [
        [title, *(shown(f"{kind}_{s}", f"{title}, {s} shots") for s in size.shown)]
        for kind, title in (("plain", "as shot"), ("ambient", "with the ambient term"))
    ]
    rows = [[s, r["plain"]["rms"], r["plain"]["bias"], r["ambient"]["rms"], r["ambient"]["bias"]] for s, r in numbers["by_step"].items()]
    return f"""# The museum

{shown("reference", "reference")}

{table(["shots", *(f"{s}" for s in size.shown)], gallery)}
Cohen, Chen, Wallace and Greenberg (SIGGRAPH 1988) showed progressive refinement on a museum that is lit over baffles in its
ceiling, so that a picture is there at once and grows better while one watches.

**Scene.** A hall of 9 x 5.4 x 16 m with six troughs across it; the lamps in them shine at the vault, and no point below sees one.
Direct light is {numbers["direct_percent"]:.0f} % of all that arrives, nearly all of it on the vault and in the troughs:

{shown("direct", "direct light alone")}

    lumel bake museum.glb --density {size.density:g} --elements {size.elements} --gather none --solver progressive --ambient --watch steps --watch-every {size.every}
    tools/picture museum_baked/museum.glb --pages steps/{size.shown[1]:06}_ -o {size.shown[1]}.png

**Error** of the steps against the reference ({reference_text(numbers)}), RMS over the mean and bias, per cent; {numbers["elements"]}
elements, the shots took {measured["shots"]["cpu"]:.0f} s of CPU time ({measured["cores"]} cores, {measured["date"]}).

{table(["shots", "RMS", "bias", "RMS, ambient term", "bias, ambient term"], rows)}
The vault is shot first, since it has most to give; walls and exhibits are black until then, for they see no lamp. With the ambient
term they are there from the first picture, flat and without shade, and shading replaces it as the shots go on.
"""
