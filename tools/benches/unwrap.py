"""Unwrappers and packers beside each other; writes `samples/studies/unwrap`."""

import json
import math
import subprocess

from benches import machine
from benches.bakes import REFERENCE
from benches.page import rounded, rows_of
from environment import ROOT

FOLDER = ROOT / "samples/studies/unwrap"
SCENES = {
    "Cornell box": "reference/cornell_box/scene.glb",
    "living room": "reference/living_room/scene.glb",
    "atrium": "reference/atrium/scene.usdc",
    "zdm2": "scenes/godot_gi_zdm2/3d/global_illumination/zdm2.glb",
    "house": "scenes/playcanvas_house/examples/assets/models/house.glb",
    "love": "scenes/playcanvas_love_neon/examples/assets/models/love.glb",
    "flight helmet": "scenes/bevy_flight_helmet/assets/models/FlightHelmet/FlightHelmet.gltf",
    "depth of field": "scenes/bevy_depth_of_field/assets/models/DepthOfFieldExample/DepthOfFieldExample.glb",
    "milk truck": "scenes/khr_milk_truck/models/CesiumMilkTruck.glb",
    "shoe": "scenes/pablode_shoe_variants/materials-variants-shoe/MaterialsVariantsShoe.usdc",
    "shader ball": "scenes/usdwg_standard_shader_ball/StandardShaderBall/standard_shader_ball_scene.usda",
    "teapot": "scenes/usdwg_teapot/Teapot/Teapot.usd",
}

HEAD = """# Unwrapping

Charts by xatlas and by the crate uvunwrap (`--unwrapper`), and our packer beside xatlas' own. Measured by `tools/bench --unwrap`
on {machine}; {date}. Every surface has a mesh of its own; all lies on one page of 1024 x 1024, 2 texels apart.

uvunwrap has fewer charts and seams, less stretch and less to compute in most scenes, but twice the seams and a tenth less of the
page in the atrium, the one large building: xatlas stays the default. Our packer fills more than xatlas' own with either's charts.

"""

NOTES = """
*Shared* are texels that two charts touch or that are nearer to another chart than the padding; *overlap* is the area in which
triangles lie on each other by more than a twentieth of a texel, by clipping every pair, of all area. *L2* and *max* are the
stretch of Sander et al. (2001), 1 for a map that keeps lengths; max is over all but the worst thousandth of the area. *Seams*
are the edges at which charts part, over the root of the area. *Filled* is the area of the surfaces at the density that was reached,
of the page's; *touched* are the texels that charts touch at least in part. *xatlas packs*: filled by its own packer (4096
random places a chart) with the very same charts, page and padding, its density found by bisection; - where there are more than
1000 charts, which its queue doesn't hold, or where padding had to be given up. CPU time is that of charting and packing together, and
of charting alone with a coarse page.
"""


def measure(only: str) -> None:
    files = {name: REFERENCE / path for name, path in SCENES.items() if only in name}
    absent = [name for name, path in files.items() if not path.is_file()]
    if absent:
        print(f"absent: {', '.join(absent)}")
    there = {str(path): name for name, path in files.items() if path.is_file()}
    command = ["cargo", "bench", "--quiet", "--ignore-rust-version", "--bench", "unwrap", "--", *there]
    figures = []
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if line.startswith("{"):
                row = json.loads(line)
                figures.append({**row, "scene": there[row["scene"]]})
                print(json.dumps(rounded(figures[-1])), flush=True)
    if process.returncode != 0:
        raise SystemExit(f"bench: `cargo bench` failed with {process.returncode}")
    if not only:
        keep(figures)


def keep(figures: list[dict]) -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    record = {"machine": machine.describe(), "figures": rounded(figures)}
    rows = ",\n  ".join(json.dumps(row) for row in record["figures"])
    kept = f'{{ "machine": {json.dumps(record["machine"])}, "figures": [\n  {rows}\n] }}\n'
    (FOLDER / "figures.json").write_text(kept)
    (FOLDER / "README.md").write_text(text(record))


def text(record: dict) -> str:
    on = record["machine"]
    head = HEAD.format(machine=f"{on['processor']}, {on['cores']} cores, {on['rustc']}", date=on["date"])
    made = [r for r in record["figures"] if "refused" not in r]
    table = [
        ["scene", "by", "triangles", "charts", "shared", "overlap", "L2", "max", "seams", "touched", "filled", "xatlas packs", "CPU s", "charting"]
    ]
    for r in made:
        packed = r["xatlas_filled"]
        table.append(
            [
                r["scene"],
                r["unwrapper"],
                f"{r['triangles']:,}",
                f"{r['charts']:,}",
                str(r["shared_texels"] + r["near_texels"]),
                f"{r['overlap']:.1e}" if r["overlap"] else "0",
                f"{r['stretch_l2']:.3f}",
                f"{r['stretch_max']:.2f}",
                f"{r['seams']:.1f}",
                percent(r["touched"]),
                percent(r["filled"]),
                "-" if packed is None else percent(packed),
                f"{r['cpu_s']:.2g}",
                "-" if r["charting_cpu_s"] is None else f"{r['charting_cpu_s']:.2g}",
            ]
        )
    return head + rows_of(table) + means(made) + NOTES


def means(made: list[dict]) -> str:
    """Means over the scenes that both were tried on."""
    lines = []
    for name in ("xatlas", "uvunwrap"):
        rows = [r for r in made if r["unwrapper"] == name]
        both = [r for r in rows if r["xatlas_filled"] is not None]
        ratio = [r["filled"] / r["xatlas_filled"] for r in both if r["xatlas_filled"]]
        mean = lambda key: sum(r[key] for r in rows) / len(rows)
        lines.append(
            f"{name}: charts {sum(r['charts'] for r in rows):,}, L2 {mean('stretch_l2'):.3f}, seams {mean('seams'):.1f}, "
            f"filled {percent(mean('filled'))}, CPU {sum(r['cpu_s'] for r in rows):.0f} s; our packer fills "
            f"{math.prod(ratio) ** (1 / max(len(ratio), 1)):.3f} times what xatlas' does, at least {min(ratio, default=0):.3f} times."
        )
    return "\nMeans and sums:\n\n" + "".join(f"- {line}\n" for line in lines)


def percent(share: float) -> str:
    return f"{100 * share:.1f} %"
