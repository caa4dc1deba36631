"""Rooms in which methods differ: a caustic, a door ajar, a lamp in a bowl, fog. Each method takes the same picture."""

import subprocess
import time
from dataclasses import dataclass

import numpy as np

from baked.display import LUMINANCE, write_png

from .scenes import methods as scenes
from .workbench import Workbench, program, shrink, significant, table

# What is tried in each room; the first is what the others are measured against.
TRIED = {
    "caustic": ("path", "bidirectional", "metropolis", "photon"),
    "door_ajar": ("path", "bidirectional", "metropolis"),
    "bowl": ("path", "bidirectional", "metropolis"),
    "fog": ("path", "photon"),
}
# Who makes the reference, a method without bias of its own.
REFERENCES = {"caustic": "bidirectional", "door_ajar": "bidirectional", "bowl": "bidirectional", "fog": "path"}
TITLES = {
    "caustic": "A ball of glass below a lamp",
    "door_ajar": "A door ajar",
    "bowl": "A lamp in a bowl",
    "fog": "Slots in fog",
}
TEXT = {
    "caustic": "Light through glass is found by chance from the eye: the lamp is small. Photons come from it.",
    "door_ajar": "The lamp is in the other room; all light comes through a gap of a hand's breadth.",
    "bowl": "The bowl hides the lamp, and the ceiling is the source of all light.",
    "fog": "Fog takes light away and shows where it goes; bidirectional paths and Metropolis refuse it by name.",
}


@dataclass
class Size:
    """Pixels of a picture; samples of each; those of the reference."""

    pixels: tuple[int, int]
    samples: int
    reference: int


FULL = Size((100, 75), 32, 512)
LIGHT = Size((24, 18), 16, 64)
SEEDS = 2
# What a room's reference takes more samples by: paths are cheap and noisy.
MORE = {"fog": 8}


def take(bench: Workbench, scene, method: str, size: tuple[int, int], samples: int, seed: int) -> tuple[np.ndarray, float]:
    """The picture (H, W, 3), and the CPU time that it took [s]."""
    import resource

    import OpenEXR

    output = bench.work / f"{scene.stem}_{method}_{samples}_{seed}.exr"
    shape = f"{size[0]}x{size[1]}"
    command = [program(), "render", scene, "-o", output, "--size", shape, "--method", method, "--samples", samples, "--seed", seed, "--quiet"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run([str(c) for c in command], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if run.returncode != 0:
        raise RuntimeError(f"{' '.join(map(str, command))}: exit {run.returncode}\n{run.stderr[-2000:]}")
    with OpenEXR.File(str(output), separate_channels=True) as f:
        channels = f.channels()
        rgb = np.stack([channels[c].pixels for c in "RGB"], -1).astype(float)
    return rgb, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def errors(picture: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """bias: mean / mean - 1; rms: root mean square over the mean; most: without the hundredth of the pixels that are off the most, whose
    bright specks decide much of the former. Luminance, per cent."""
    a, b = picture @ LUMINANCE, truth @ LUMINANCE
    squares = np.sort(((a - b) ** 2).ravel())
    kept = squares[: len(squares) - len(squares) // 100]
    rms = lambda of: significant(100 * np.sqrt(of.mean()) / b.mean())
    return {"bias": significant(100 * (a.mean() / b.mean() - 1)), "rms": rms(squares), "most": rms(kept)}


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    numbers, measured = {}, {}
    for name, tried in TRIED.items():
        scene = bench.write(scenes.SCENES[name]())
        samples = size.reference * MORE.get(name, 1)
        halves = [take(bench, scene, REFERENCES[name], size.pixels, samples, seed) for seed in (7, 8)]
        truth = (halves[0][0] + halves[1][0]) / 2
        # Half of what two halves differ by is the error of their mean.
        own = {key: significant(errors(halves[0][0], halves[1][0])[key] / 2, 2) for key in ("rms", "most")}
        numbers[name] = {"reference": own}
        measured[name] = {"reference": {"cpu": significant(sum(t for _, t in halves), 3)}}
        exposure = 0.18 / np.exp(np.log(np.maximum(truth @ LUMINANCE, 1e-6)).mean())
        if size is FULL:
            draw(bench, f"{name}_reference", truth, exposure)
        for method in tried:
            made = [take(bench, scene, method, size.pixels, size.samples, seed) for seed in range(SEEDS)]
            found = [errors(picture, truth) for picture, _ in made]
            mean = {key: significant(float(np.mean([f[key] for f in found])), 3) for key in ("bias", "rms", "most")}
            numbers[name][method] = mean
            measured[name][method] = {"cpu": significant(float(np.mean([t for _, t in made])), 3)}
            if size is FULL:
                draw(bench, f"{name}_{method}", made[0][0], exposure)
        first = tried[0]
        for method in tried:
            # Error falls as the root of time.
            of = lambda m: measured[name][m]["cpu"] * numbers[name][m]["most"] ** 2
            measured[name][method]["time_for_equal_error"] = significant(of(method) / of(first), 3)
            times = measured[name][first]["cpu"] / measured[name][method]["cpu"]
            measured[name][method]["error_in_equal_time"] = significant(numbers[name][method]["most"] / times**0.5, 3)
    return numbers, measured


def against(numbers: dict, measured: dict) -> str:
    """Bidirectional paths and Metropolis at the same work."""
    if "metropolis" not in numbers:
        return ""
    cost = lambda m: measured[m]["cpu"] * numbers[m]["most"] ** 2
    times = significant(cost("metropolis") / cost("bidirectional"), 2)
    return f"For equal error Metropolis takes {times} times what bidirectional paths take."


def draw(bench: Workbench, name: str, rgb: np.ndarray, exposure: float) -> None:
    path = bench.page / f"{name}.png"
    write_png(path, rgb, exposure, np.ones(rgb.shape[:2], bool))
    shrink(path)


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    width, height = size.pixels
    text = f"""# Where methods differ

Pictures of {width} x {height} pixels through the same camera, {size.samples} samples of each pixel by each method. *Error* is the root mean
square over the mean; *of 99 %* leaves out the hundredth of the pixels that are off the most. Both are means of {SEEDS} seeds against a
reference of two halves of {size.reference} samples (eight times as many by paths), whose own error, half of what the halves differ by, stands below each table. Times are
CPU seconds of the whole process, on {measured["cores"]} cores of {measured["machine"]}, {measured["date"]}; about 0.3 s of each is for the start.
*In equal time* is the error of 99 % in the time that path tracing took, *time for equal error* the share of path tracing's time to come to
its error of 99 %, as error falls with the root of time; a few pixels in the focus of a caustic decide the whole error, also the reference's; photon mapping also has a bias, which falls with its radius, pass by pass.

    tools/study methods
"""
    for name, tried in TRIED.items():
        rows = []
        for method in tried:
            found, took = numbers[name][method], measured[name][method]
            errors_of = [found["rms"], found["most"], f"{found['bias']:+.2g}"]
            rows.append([f"`{method}`", *errors_of, took["cpu"], took["error_in_equal_time"], took["time_for_equal_error"]])
        head = ["method", "error [%]", "of 99 % [%]", "bias [%]", "CPU s", "in equal time [%]", "time for equal error"]
        own = numbers[name]["reference"]
        pictures = [f"![{m}]({name}_{m}.png)" for m in ("reference", *tried)]
        names = " | ".join(("reference", *tried))
        text += f"""
## {TITLES[name]}

{TEXT[name]}

{table(head, rows)}
The reference, by `{REFERENCES[name]}`, is off by {own["rms"]} %, {own["most"]} % of 99 %. {against(numbers[name], measured[name])}

| {names} |
|{"---|" * len(pictures)}
| {" | ".join(pictures)} |
"""
    return text
