"""What becomes of every scene file of the reference folder: baked, baked in part, or refused, and why.

`tests/outcomes.txt` keeps the expected outcomes, one line a file. `LUMEL_OUTCOMES=write` writes it anew; look at what changed.
"""

import json
import os
import re
import resource
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from environment import ROOT

TABLE = ROOT / "tests" / "outcomes.txt"
FORMATS = {".gltf", ".glb", ".usd", ".usda", ".usdc", ".usdz"}
ARGUMENTS = ("--quality", "draft", "--resolution", "128", "--sky", "1", "--gltf", "engine", "--threads", "1")
# A property of a type that its schema doesn't give it; the value can be read all the same.
HARMLESS = {"badPropertyType.usd"}
LONGEST = 60  # seconds
MOST_MEMORY = 4 << 30  # bytes, of addresses: more than what is held


def outcome(scene: Path, root: Path, folder: Path) -> tuple[str, dict]:
    """A line for the table, and the report of a bake that succeeded."""
    program = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "lumel"

    def limit():
        # The USD reader's stack alone takes half a gigabyte of addresses, most of them never touched.
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))

    command = [program, "bake", scene, "-o", folder, *ARGUMENTS, "--quiet"]
    try:
        done = subprocess.run(command, capture_output=True, timeout=LONGEST, preexec_fn=limit)
    except subprocess.TimeoutExpired:
        return f"{scene.relative_to(root)}: hangs", {}
    name = scene.relative_to(root)
    if done.returncode == 0:
        report = json.loads((folder / "report.json").read_text())
        # The USD reader reports what it met in any order.
        counts = sorted(f"{w['count']} x {w['message']}" for w in report["warnings"])
        return f"{name}: " + (f"partly: {'; '.join(counts)}" if counts else "baked"), report
    text = done.stderr.decode(errors="replace").strip().splitlines()
    if done.returncode != 1 or not text or "internal error" in text[-1]:
        return f"{name}: dies ({done.returncode}): {text[-1:]}", {}
    return f"{name}: refused: {text[-1].removeprefix('error: ')}", {}


def shortened(line: str, root: Path) -> str:
    """One line, without where the folder lies, nor the places of cycles: openusd gives them in any order."""
    line = line.replace(f"{root}/", "")
    line = re.sub(r"(the scene holds no triangles to bake) \(.*", r"\1", line)
    line = re.sub(r"(composition arc cycle) at [^;)]+", r"\1", re.sub(r"\s+", " ", line))
    return line if len(line) <= 400 else line[:397] + "..."


@pytest.fixture(scope="module")
def outcomes(scenes, tmp_path_factory):
    root = scenes.resolve()
    files = sorted(p for p in root.rglob("*") if p.suffix.lower() in FORMATS and p.is_file())
    folder = tmp_path_factory.mktemp("outcomes")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = pool.map(lambda item: outcome(item[1], root, folder / str(item[0])), enumerate(files))
    return root, {str(s.relative_to(root)): (shortened(line, root), report) for s, (line, report) in zip(files, found)}


def test_every_outcome_is_the_expected_one(outcomes):
    _, found = outcomes
    lines = [line for line, _ in found.values()]
    if os.environ.get("LUMEL_OUTCOMES") == "write":
        TABLE.write_text("\n".join(lines) + "\n")
    expected = TABLE.read_text().splitlines()
    gone = sorted(set(expected) - set(lines))
    new = sorted(set(lines) - set(expected))
    assert not gone and not new, "\n".join(["expected:", *gone, "found:", *new])


def test_nothing_dies_or_hangs(outcomes):
    _, found = outcomes
    assert not [line for line, _ in found.values() if ": dies (" in line or line.endswith(": hangs")]


def test_bad_files_are_refused_or_warned_of(outcomes):
    _, found = outcomes
    silent = []
    for file, (line, report) in found.items():
        # The sky that the check itself adds is no fault of the file.
        about_file = [w for w in report.get("warnings", []) if not w["message"].startswith("a sky can't be expressed")]
        if "_bad" in file.split("/")[0] and ": refused: " not in line and not about_file:
            silent.append(Path(file).name)
    assert set(silent) == HARMLESS


def test_main_scenes_bake(outcomes):
    """Some folders were stored without the leading part of the path that the manifest names."""
    root, found = outcomes
    entries = json.loads((root / "MANIFEST.json").read_text())
    failed = []
    for entry in entries:
        if "_bad" in entry["name"]:
            continue
        for main in entry.get("main", []):
            mine = [f for f in found if f.startswith(f"{entry['name']}/") and f.endswith("/" + main.rsplit("/", 1)[-1])]
            failed += [found[f][0] for f in mine if ": refused: " in found[f][0]]
    assert not failed
