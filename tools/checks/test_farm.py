"""Bakes on a farm: by a Ray cluster one of whose workers is killed, and as a job of Open Job Description."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from conftest import ROOT, SAMPLES, TOOLS, lumel

PROGRAM = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "lumel"
# What the report says of the run, not of its result.
OF_THE_RUN = ("stages", "peak_memory_bytes", "rays", "warnings", "reused")


def python_with(module: str, variable: str) -> str:
    """An interpreter that has `module`: this one, or the one that the environment names; skips where neither does."""
    named = os.environ.get(variable)
    if named:
        return named
    if find_spec(module) is None:
        pytest.skip(f"no {module} here; {variable} may name an interpreter that has it")
    return sys.executable


def result(folder: Path) -> dict[str, str]:
    """Hashes of what a bake left, by name, but for what is hidden."""
    hashes = {}
    for file in sorted(f for f in folder.rglob("*") if f.is_file()):
        name = file.relative_to(folder).as_posix()
        if name.startswith("."):
            continue
        content = file.read_bytes()
        if name == "report.json":
            content = json.dumps({k: v for k, v in json.loads(content).items() if k not in OF_THE_RUN}).encode()
        hashes[name] = hashlib.sha256(content).hexdigest()
    return hashes


def succeeded(run: subprocess.CompletedProcess) -> subprocess.CompletedProcess:
    assert run.returncode == 0, f"exit {run.returncode}\n{run.stdout[-3000:]}\n{run.stderr[-3000:]}"
    return run


def shards_of(plan: Path) -> list[int]:
    """Processes that are at shards of `plan` now."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if b"--shard" in words and str(plan).encode() in words:
                found.append(int(entry.name))
    return found


def parent_of(process: int) -> int:
    return int(Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[1])


def bake_by_ray(scene: Path, options: list[str], folder: Path, worker: bool) -> None:
    """Bakes `scene` by three shards, of which one is killed on the way, with the worker of Ray that started it or alone, and on its own."""
    python = python_with("ray", "LUMEL_RAY_PYTHON")
    plain, job = folder / "plain", folder / "job"
    succeeded(lumel("bake", scene, "-o", plain, *options))
    succeeded(lumel("plan", scene, "--shards", 3, *options, "-o", job))
    script = [python, TOOLS / "farm" / "ray_bake.py", job / "plan.json", "-o", folder / "out", "--lumel", PROGRAM]
    process = subprocess.Popen([str(a) for a in script], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    killed = None
    while process.poll() is None and killed is None:
        kept = [f for f in (job / "cache").rglob("*") if f.is_file() and f.parent.name.startswith("look") and not f.name.startswith(".")]
        at_work = shards_of(job / "plan.json")
        if kept and at_work:
            killed = parent_of(at_work[0]) if worker else at_work[0]
            os.kill(killed, signal.SIGKILL)
        time.sleep(0.01)
    text, _ = process.communicate(timeout=1800)
    assert process.returncode == 0, text
    assert killed is not None, f"nothing could be killed on the way:\n{text}"
    assert text.count("did ") >= 3, text
    assert result(folder / "out") == result(plain)
    assert not shards_of(job / "plan.json"), "shards outlive the cluster"


@pytest.mark.parametrize("worker", [False, True])
def test_a_cluster_bakes_although_a_process_is_killed(tmp_path, worker):
    options = ["--resolution", "256", "--error", "0.6%"]
    bake_by_ray(SAMPLES / "cornell_box" / "cornell_box.glb", options, tmp_path, worker)


@pytest.mark.slow
def test_a_cluster_bakes_the_atrium_although_a_worker_is_killed(tmp_path, reference):
    scene = reference / "reference" / "atrium" / "scene.usdc"
    bake_by_ray(scene, ["--resolution", "512", "--uv", "keep"], tmp_path, True)


def test_a_plan_is_a_job_of_open_job_description(tmp_path):
    python = python_with("openjd", "LUMEL_OPENJD_PYTHON")
    scene, options = SAMPLES / "cornell_box" / "cornell_box.usda", ["--resolution", "128", "--quality", "draft"]
    plain, job = tmp_path / "plain", tmp_path / "job"
    succeeded(lumel("bake", scene, "-o", plain, *options))
    succeeded(lumel("plan", scene, "--shards", 3, *options, "-o", job))

    def openjd(*words) -> subprocess.CompletedProcess:
        command = [python, "-m", "openjd", *map(str, words)]
        return succeeded(subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=900))

    openjd("check", job / "template.yaml")
    steps = ["--step", "Merge", "--run-dependencies", "-p", f"Lumel={PROGRAM}"]
    # As near to the scene as the other: the layer names it from there.
    run = openjd("run", job / "template.yaml", *steps, "-p", f"Scene={scene}", "-p", f"Output={tmp_path / 'out'}")
    assert "openjd_progress: 100" in run.stdout and "shards had done all" in run.stdout, run.stdout[-3000:]
    assert result(tmp_path / "out") == result(plain)

    # Paths that differ on the machine at work are mapped.
    moved = tmp_path / "moved"
    moved.mkdir()
    (moved / scene.name).write_bytes(scene.read_bytes())
    rule = {"source_path_format": "POSIX", "source_path": "/studio", "destination_path": str(moved)}
    rules = json.dumps({"version": "pathmapping-1.0", "path_mapping_rules": [rule]})
    places = ["-p", f"Scene=/studio/{scene.name}", "-p", "Output=/studio/out", "-p", "Cache=/studio/cache"]
    openjd("run", job / "template.yaml", *steps, "--path-mapping-rules", rules, *places)
    pages = {k: v for k, v in result(moved / "out").items() if k.startswith("lightmaps/")}
    assert pages and pages.items() <= result(plain).items()
