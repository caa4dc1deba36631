"""The studies say what they say: small versions of each, run again. No time is held, only numbers."""

import json

import pytest
import studies
from conftest import SAMPLES
from studies import workbench

# What a committed number may differ by from the same number made again on another machine.
TOLERANCE = 0.05
# Points below which a difference in per cent means nothing.
FLOOR = 0.3


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    """The numbers of a study's small version."""
    made: dict[str, dict] = {}

    def call(name: str) -> dict:
        if name not in made:
            study, folder = studies.load(name), tmp_path_factory.mktemp(name)
            bench = workbench.Workbench(folder, folder, workbench.LIGHT_QUALITY)
            # Through JSON, as the committed numbers went.
            made[name] = json.loads(json.dumps(study.measure(bench, study.LIGHT)[0]))
            print(name, made[name])
        return made[name]

    return call


def leaves(value, path=""):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, f"{path}/{key}")
    else:
        yield path, value


def committed(name: str) -> dict:
    return json.loads((SAMPLES / "studies" / name / "numbers.json").read_text())


@pytest.mark.parametrize("name", studies.NAMES)
def test_numbers_are_the_committed_ones(name, small):
    now, then = dict(leaves(small(name))), dict(leaves(committed(name)["light"]))
    assert now.keys() == then.keys(), f"samples/studies/{name} is out of date: run tools/study {name}"
    for path, value in now.items():
        assert value == pytest.approx(then[path], rel=TOLERANCE, abs=FLOOR), f"{path}: run tools/study {name} and look at its page"


@pytest.mark.parametrize("name", studies.NAMES)
def test_page_shows_every_picture(name):
    folder = SAMPLES / "studies" / name
    text = (folder / "README.md").read_text()
    pictures = sorted(f.name for f in folder.glob("*.png"))
    assert pictures and [p for p in pictures if f"]({p})" not in text] == []


def test_pages_stay_small():
    assert sum(f.stat().st_size for f in (SAMPLES / "studies").rglob("*") if f.is_file()) < 2_000_000


def test_full_matrix_agrees_with_closed_forms_and_with_shooting(small):
    for row in small("box_1984")["by_edge"].values():
        assert row["analytic"]["rms"] < 0.3, row
        assert abs(row["analytic"]["bias"]) < 0.1, row
        assert row["progressive"]["rms"] < 0.5, row
        assert row["interpolated"]["rms"] < row["flat"]["rms"], row


def test_patches_halve_the_error_of_the_1984_box():
    rows = list(committed("box_1984")["full"]["by_edge"].values())
    for coarse, fine in zip(rows, rows[1:]):
        assert fine["flat"]["rms"] < 0.6 * coarse["flat"]["rms"]


@pytest.mark.parametrize("name", studies.NAMES)
def test_reference_agrees_with_path_tracing(name, small):
    # The small versions have few and large texels, the full ones enough of them.
    assert abs(small(name)["reference_bias"]) < 4
    assert abs(committed(name)["full"]["reference_bias"]) < 1.5


def test_hemicube_error_falls_with_its_resolution(small):
    rows = [row["against_finest"]["rms"] for row in small("box_1985")["by_cells"].values()]
    assert rows == sorted(rows, reverse=True), rows
    assert rows[-1] < 0.5 * rows[0], rows


def test_ambient_term_helps_early_and_sweeps_converge(small):
    f = small("convergence")
    for step in ("1", "2", "24"):
        assert f["ambient"][step] < 0.5 * f["progressive"][step], step
    assert list(f["progressive"].values()) == sorted(f["progressive"].values(), reverse=True)
    assert f["gauss_seidel"]["24"] < 0.5
    # As many columns as a sweep has rows: shooting the strongest first is ahead.
    assert f["progressive"]["equal_work"] < f["gauss_seidel"]["1"]


def test_factory_after_2000_shots(small):
    steps = list(small("factory")["by_step"].values())
    assert [s["plain"]["rms"] for s in steps] == sorted((s["plain"]["rms"] for s in steps), reverse=True)
    assert all(s["ambient"]["rms"] < s["plain"]["rms"] for s in steps)
    full = committed("factory")["full"]
    assert 25_000 < full["patches"] < 35_000 and full["shots"] == 2000
    assert full["by_step"]["2000"]["ambient"]["rms"] < 12, full["by_step"]["2000"]


def test_museum_is_lit_indirectly(small):
    f = small("museum")
    assert f["direct_percent"] < 40
    first, *_, last = f["by_step"].values()
    assert first["ambient"]["rms"] < first["plain"]["rms"]
    assert last["plain"]["rms"] < 0.7 * first["plain"]["rms"]


def test_table_error_falls_with_density(small):
    rows = list(small("table")["by_density"].values())
    for kind in ("flat", "interpolated"):
        errors = [row[kind]["rms"] for row in rows]
        assert errors == sorted(errors, reverse=True), errors
    # Gaps between the books are in the figure: a texel shows its open part there, however dark the rest is.
    assert rows[-1]["interpolated"]["rms"] < 0.65 * rows[0]["interpolated"]["rms"]
