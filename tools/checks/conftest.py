"""What the checks share: the command, bakes that are made once a session, the reference folder, a place for pictures."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(TOOLS))
from environment import ROOT, python_of

SAMPLES = ROOT / "samples"
# The samples as the checks bake them: enough texels to mean something, few enough to be quick.
SAMPLE_BAKES = {
    "cornell_box.glb": ("cornell_box/cornell_box.glb", "--quality", "medium", "--resolution", "256"),
    "cornell_box.usda": ("cornell_box/cornell_box.usda", "--quality", "medium", "--resolution", "256"),
    "furnace.glb": ("furnace/furnace.glb", "--quality", "medium", "--resolution", "64"),
    "furnace.usda": ("furnace/furnace.usda", "--quality", "medium", "--resolution", "64"),
    "sunroom.usda": ("sunroom/sunroom.usda", "--quality", "medium", "--resolution", "256"),
}


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="run the checks that take minutes as well")


def pytest_configure(config):
    config.addinivalue_line("markers", "slow: takes minutes; run with --slow")


def pytest_collection_modifyitems(config, items):
    if not config.getoption("--slow"):
        for item in items:
            if "slow" in item.keywords:
                item.add_marker(pytest.mark.skip(reason="takes minutes: tools/test --slow"))


@dataclass
class Bake:
    """A finished bake."""

    scene: Path
    folder: Path
    stderr: str

    @property
    def glb(self) -> Path:
        return self.folder / f"{self.scene.stem}.glb"

    @property
    def vertex_glb(self) -> Path:
        return self.folder / f"{self.scene.stem}.vertex.glb"

    @property
    def layer(self) -> Path:
        return self.folder / f"{self.scene.stem}.lumel.usda"

    @property
    def report(self) -> dict:
        return json.loads((self.folder / "report.json").read_text())


def lumel(*arguments) -> subprocess.CompletedProcess:
    """Runs the command that `tools/test` has built."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    program = target / "release" / "lumel"
    assert program.exists(), f"{program} is missing: cargo build --release --ignore-rust-version"
    return subprocess.run([program, *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=1800)


class Baker:
    """Bakes each scene once for each list of arguments."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.done: dict[tuple, Bake] = {}

    def __call__(self, scene: Path, *arguments) -> Bake:
        key = (scene, *map(str, arguments))
        if key not in self.done:
            place = self.folder / f"{len(self.done):02}_{scene.stem}"
            run = lumel("bake", scene, "-o", place, *arguments)
            shown = f"lumel bake {scene} {' '.join(map(str, arguments))}"
            assert run.returncode == 0, f"{shown}: exit {run.returncode}\n{run.stderr[-3000:]}"
            self.done[key] = Bake(scene, place, run.stderr)
        return self.done[key]

    def sample(self, name: str) -> Bake:
        path, *arguments = SAMPLE_BAKES[name]
        return self(SAMPLES / path, *arguments)


@pytest.fixture(scope="session")
def bake(tmp_path_factory) -> Baker:
    return Baker(tmp_path_factory.mktemp("bakes"))


@pytest.fixture(scope="session")
def reference() -> Path:
    """The folder with reference scenes and values; skips where it is absent."""
    folder = Path(os.environ.get("LUMEL_REFERENCE", ROOT.parent / "shared"))
    if not (folder / "tools" / "lightmap_error.py").is_file():
        pytest.skip(f"no reference values in {folder} (LUMEL_REFERENCE names the folder)")
    return folder.resolve()


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder with real scenes; skips where it is absent."""
    folder = Path(os.environ.get("LUMEL_REFERENCE", ROOT.parent / "shared")) / "scenes"
    if not folder.is_dir():
        pytest.skip(f"no scenes in {folder} (LUMEL_REFERENCE names the folder above)")
    return folder.resolve()


@pytest.fixture(scope="session")
def pictures() -> Path:
    """Where pictures for people are kept, below the ignored `target`."""
    folder = ROOT / "target" / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def blender():
    """Runs a script of `tools/blender` in Blender's own process and returns the JSON of its last line."""

    def call(script: str, *arguments) -> dict:
        command = [python_of("blender"), TOOLS / "blender" / script, *map(str, arguments)]
        env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "DISPLAY")}
        run = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=900, env=env)
        assert run.returncode == 0, f"{script}: exit {run.returncode}\n{run.stdout[-1500:]}\n{run.stderr[-3000:]}"
        lines = [line for line in run.stdout.splitlines() if line.startswith("{")]
        assert lines, f"{script} printed no result:\n{run.stdout[-1500:]}"
        return json.loads(lines[-1])

    return call


@pytest.fixture(scope="session")
def three():
    """Renders a baked GLB in three.js (`tools/three/render.py`); skips where no Chromium is."""
    sys.path.insert(0, str(TOOLS / "three"))
    import render

    if render.browser() is None:
        pytest.skip("no chromium on the PATH: apt-get install -y --no-install-recommends chromium")
    return render.render


@pytest.fixture(scope="session")
def gltf_errors():
    """Errors of the Khronos validator in a file: a list of { code, message, pointer }."""

    def call(*files: Path) -> dict[str, list[dict]]:
        env = {"NODE_PATH": str(ROOT / ".venv-node" / "node_modules")} | dict(os.environ)
        command = ["node", TOOLS / "gltf_validator" / "validate.cjs", *files]
        run = subprocess.run([str(c) for c in command], stdin=subprocess.DEVNULL, capture_output=True, text=True, env=env)
        assert run.returncode == 0, f"the glTF validator failed: {run.stderr[-2000:]}"
        return {Path(k).name: v["errors"] for k, v in json.loads(run.stdout).items()}

    return call
