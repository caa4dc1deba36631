"""What every study does: write a scene, bake it in several ways, measure one bake against another, draw pictures for its page."""

import json
import os
import subprocess
import textwrap
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from baked import camera, display, triangles
from baked.display import LUMINANCE
from baked.energy import points
from baked.pages import Page, read_page
from baked.raycast import Caster
from environment import ROOT
from sample_scenes import glb
from sample_scenes.model import Scene

# Of references in the small versions that the checks run.
LIGHT_QUALITY = "medium"
# Paths from each texel: their noise evens out over all texels, so that few are enough for the mean.
PATHS = 64


@dataclass
class Bake:
    """A finished bake; `watched` holds the pages of its steps where they were kept."""

    name: str
    folder: Path
    watched: Path | None = None

    @property
    def glb(self) -> Path:
        return self.folder / f"{self.name}.glb"

    @cached_property
    def report(self) -> dict:
        return json.loads((self.folder / "report.json").read_text())

    @property
    def solver(self) -> dict:
        return self.report["solver"]

    def pages(self, step: int | None = None) -> list[Page]:
        if step is not None:
            return [read_page(f"{self.prefix(step)}{k}.exr") for k in range(len(self.report["pages"]))]
        return [read_page(self.folder / p["uri"]) for p in self.report["pages"]]

    def prefix(self, step: int) -> str:
        """What the file names of a watched step's pages begin with."""
        return f"{self.watched}/{step:06}_"

    def seconds(self, *stages: str) -> dict[str, float]:
        """Wall and CPU time of these stages [s], measured on the day."""
        rows = [s for s in self.report["stages"] if s["name"] in stages]
        return {kind: significant(sum(s[f"{kind}_s"] for s in rows), 3) for kind in ("wall", "cpu")}


@dataclass
class Workbench:
    """Bakes go below `work`, pictures to `page`; equal bakes are made once."""

    work: Path
    page: Path
    reference_quality: str = "high"
    done: dict[tuple, Bake] = field(default_factory=dict)
    casters: dict[Path, Caster] = field(default_factory=dict)

    def write(self, scene: Scene) -> Path:
        self.work.mkdir(parents=True, exist_ok=True)
        path = self.work / f"{scene.name}.glb"
        glb.write(scene, path)
        return path

    def bake(self, scene: Path, *arguments, watch_every: int | None = None, vertices: bool = False) -> Bake:
        """Geometric normals, 32-bit pages, no vertex colours unless they are asked for: what most studies compare is the texels."""
        key = (scene, *map(str, arguments), watch_every, vertices)
        if key not in self.done:
            folder = self.work / f"{len(self.done):02}_{scene.stem}"
            watch = [] if watch_every is None else ["--watch", folder / "watch", "--watch-every", watch_every]
            common = ["--normals", "geometric", "--float", "--gltf", "engine,vertex" if vertices else "engine", "--overwrite", "--quiet"]
            command = [str(c) for c in (program(), "bake", scene, "-o", folder, *common, *arguments, *watch)]
            run = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
            if run.returncode != 0:
                raise RuntimeError(f"{' '.join(command)}: exit {run.returncode}\n{run.stderr[-2000:]}")
            self.done[key] = Bake(scene.stem, folder, folder / "watch" if watch else None)
        return self.done[key]

    def vertices(self, bake: Bake) -> Bake:
        """The same bake as its vertex colours show it."""
        return Bake(f"{bake.name}.vertex", bake.folder)

    def reference(self, scene: Path, density: float, samples: int) -> Bake:
        return self.bake(scene, "--density", density, "--quality", self.reference_quality, "--samples", samples)

    def reference_bias(self, scene: Path, density: float, samples: int) -> float:
        """How far the reference's mean is off path tracing's [%]: a method that shares no form factor with it."""
        paths = self.bake(scene, "--density", density, "--method", "path", "--samples", PATHS)
        return page_error(self.reference(scene, density, samples).pages(), paths.pages())["bias"]

    def render(self, bake: Bake, size: tuple[int, int], step: int | None = None, flat: bool = False, view=None):
        """Radiance (H, W, 3) through the scene's camera, and what share of each pixel is covered."""
        if bake.glb not in self.casters:
            self.casters[bake.glb] = Caster(triangles.load(bake.glb))
        caster = self.casters[bake.glb]
        if "vertexScale" not in caster.triangles.lumel:
            caster.triangles.pages, caster.triangles.flat = bake.pages(step), flat
        view = view or camera.from_gltf(bake.glb)
        assert view is not None, f"{bake.glb} has no camera"
        return caster.picture(view, *size, 3)

    def picture(self, name: str, bake: Bake, size: tuple[int, int] = (480, 360), exposure: float | None = None, **options) -> float:
        """Draws `name`.png on the page; returns the exposure, for pictures that belong beside it."""
        rgb, covered = self.render(bake, size, **options)
        path = self.page / f"{name}.png"
        used = display.write_png(path, rgb, exposure, covered > 0)
        shrink(path, dither=not options.get("flat"))
        return used

    def wire_picture(self, name: str, bake: Bake, size: tuple[int, int] = (480, 360), exposure: float | None = None) -> None:
        """[`picture`] with the edges of triangles in white."""
        rgb, covered = self.render(bake, size)
        caster, view, samples = self.casters[bake.glb], camera.from_gltf(bake.glb), 4
        origin, direction = view.rays(*size, samples)
        triangle, weights = caster.closest(origin, direction)
        p = caster.triangles.position[triangle]
        sides = np.linalg.norm(p[:, [2, 0, 1]] - p[:, [1, 2, 0]], axis=2)
        height = np.linalg.norm(caster.normals[triangle], axis=1, keepdims=True) / sides
        away = np.linalg.norm((p * weights[..., None]).sum(1) - origin, axis=1, keepdims=True)
        pixel = away * 2 * np.tan(np.radians(view.fov) / 2) / size[1]
        edge = ((weights * height < 0.4 * pixel).any(1) & (triangle >= 0)).reshape(size[1], size[0], -1).mean(-1, keepdims=True)
        path = self.page / f"{name}.png"
        white = 0.8 / (exposure or 1.0)
        display.write_png(path, rgb * (1 - 0.6 * edge) + white * 0.6 * edge, exposure, covered > 0)
        shrink(path)

    def error_picture(self, name: str, bake: Bake, reference: Bake, size=(480, 360), percent=20.0, both_flat=False, **options) -> None:
        """The relative error that the camera sees, in the colours of `lumel compare`: blue darker, red brighter than the reference."""
        files = []
        for part, of, flat in (("test", bake, both_flat), ("truth", reference, both_flat)):
            files.append(self.work / f"{part}.exr")
            write_exr(files[-1], *self.render(of, size, flat=flat, **options))
        path = self.page / f"{name}.png"
        command = [program(), "compare", *files, "-o", path, "--range", percent, "--json"]
        run = subprocess.run([str(c) for c in command], stdin=subprocess.DEVNULL, capture_output=True, text=True)
        if run.returncode != 0:
            raise RuntimeError(f"lumel compare: exit {run.returncode}\n{run.stderr[-2000:]}")
        shrink(path)


def program() -> Path:
    path = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "lumel"
    if not path.exists():
        raise SystemExit(f"study: {path} is missing: cargo build --release --ignore-rust-version")
    return path


def write_exr(path: Path, rgb: np.ndarray, covered: np.ndarray) -> None:
    import OpenEXR

    rgba = np.concatenate([rgb, (covered > 0)[..., None]], -1).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGBA": rgba}) as f:
        f.write(str(path))


def shrink(path: Path, dither: bool = False) -> None:
    """Rewrites a PNG with a palette of its own: a third of the size. Dithered, smooth shading gets no bands of its own."""
    from PIL import Image

    full = Image.open(path).convert("RGB")
    small = full.quantize(255, method=Image.Quantize.MAXCOVERAGE, kmeans=4)
    if dither:
        small = full.quantize(palette=small, dither=Image.Dither.FLOYDSTEINBERG)
    small.save(path, optimize=True)


def error(test: np.ndarray, reference: np.ndarray, weight: np.ndarray | float = 1.0) -> dict[str, float]:
    """bias: mean / mean - 1; rms: root mean square of the difference over the reference's mean. Luminance, per cent."""
    a, b = test @ LUMINANCE, reference @ LUMINANCE
    w = np.broadcast_to(weight, a.shape) / np.sum(np.broadcast_to(weight, a.shape))
    mean = (w * b).sum()
    return {
        "bias": significant(100 * ((w * a).sum() / mean - 1)),
        "rms": significant(100 * np.sqrt((w * (a - b) ** 2).sum()) / mean),
    }


def page_error(test: list[Page], reference: list[Page]) -> dict[str, float]:
    """Texel by texel, weighted by the reference's coverage: for bakes whose pages are laid out alike."""
    for a, b in zip(test, reference, strict=True):
        assert a.coverage.shape == b.coverage.shape, "the pages are laid out differently"
    weight = np.concatenate([p.coverage.ravel() for p in reference]).astype(float)
    a, b = (np.concatenate([p.rgb.reshape(-1, 3) for p in pages]).astype(float)[weight > 0] for pages in (test, reference))
    return error(a, b, weight[weight > 0])


def surface_error(test: Bake, reference: Bake, step: int | None = None, flat: bool = False, count: int = 200_000) -> dict[str, float]:
    """At points spread evenly over all surfaces: for bakes of one scene whose pages differ. `flat`: `test` unfiltered."""
    a, b = triangles.load(test.glb, None if step is None else test.prefix(step)), triangles.load(reference.glb)
    assert np.allclose(a.position, b.position, atol=1e-5), "the bakes are of different scenes"
    a.flat = flat
    triangle, weights, _ = points(b, count)
    values = [triangles.lightmap_at(t, triangle, weights) for t in (a, b)]
    seen = ~buried(b, triangle, weights)
    return error(*(np.nan_to_num(v)[seen] for v in values))


def buried(t: triangles.Triangles, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Points whose texel has no open area: it lies inside a solid, and what it holds is filled in."""
    uv = (t.page_uv[triangle] * weights[..., None]).sum(1)
    out = np.ones(len(triangle), bool)
    for k, page in enumerate(t.pages):
        at = t.page[triangle] == k
        h, w = page.coverage.shape
        x, y = np.floor(uv[at] * [w, h]).astype(int).T
        out[at] = page.coverage[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)] <= 0
    return out


def reference_text(numbers: dict) -> str:
    return f"a final gather over a fine solution; its mean is {numbers['reference_bias']:+.2g} % off path tracing's"


def significant(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")


def table(head: list[str], rows: list[list]) -> str:
    """A Markdown table; numbers with three digits."""

    def cell(v) -> str:
        return f"{v:.3g}" if isinstance(v, float) else str(v)

    lines = [head, ["---"] * len(head), *[[cell(v) for v in row] for row in rows]]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def wrapped(text: str, width: int = 132) -> str:
    """Prose broken again after numbers have been filled in; headings, tables, pictures and code stay as they are."""
    parts = text.split("\n\n")
    prose = [not part.startswith(("#", "|", "    ", "![", "\n")) and "\n|" not in part for part in parts]
    fill = partial(textwrap.fill, width=width, break_long_words=False, break_on_hyphens=False)
    return "\n\n".join(fill(part) if is_prose else part for part, is_prose in zip(parts, prose)).rstrip() + "\n"


def shown(name: str, alt: str) -> str:
    return f"![{alt}]({name}.png)"
