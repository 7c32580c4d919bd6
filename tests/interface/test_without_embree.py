"""Where `embreex` cannot be imported the built-in tracer casts every ray, and says so once."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import urbantwin as ut

pytestmark = pytest.mark.thorough

MILLIMETRE = 1e-3
#: Its `sitecustomize` hides the package from every process.
WITHOUT = Path(__file__).parents[1] / "without_embree"


#: One process for all commands, which saves the imports.
PROGRAM = """
import json, sys
from urbantwin.cli import main
for command in json.load(sys.stdin):
    print(main(command), file=sys.stderr, flush=True)
"""


def run(*commands):
    """Run commands where Embree is missing; return what each said, and then its code, by line."""
    paths = [str(WITHOUT), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        input=json.dumps([list(map(str, one)) for one in commands]),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stderr.splitlines()


@pytest.fixture(scope="module")
def recorded(line, tmp_path_factory):
    """What two workers record, and what else is made without Embree; and ``bvh`` where it is."""
    folder = tmp_path_factory.mktemp("recorded")
    record = ["record", line.twin.folder, line.motion.folder, "-q"]
    said = run(
        [*record[:-1], "--stop", 0.2, "--no-pictures", "-o", folder / "two", "--workers", 2],
        ["build", line.site, "-o", folder / "twin", "--no-pictures", "-q"],
        ["rig", "coverage", line.twin.folder, "--cell", 2, "--no-pictures", "-o", folder / "map"],
        [*record, "--backend", "embree", "-o", folder / "out"],
    )
    ut.record(
        line.twin, line.motion, folder / "bvh", stop=0.2, backend="bvh", workers=1,
        pictures=False, progress=False,
    )  # fmt: skip
    return folder, said


def points_of(dataset):
    """Return place and label of every point of three frames, by frame and beam."""
    found = {}
    for file in sorted((dataset / "points").glob("*.npy"))[:3]:
        rays = np.load(dataset / "rays" / file.name)
        label = np.fromfile(dataset / "semantic" / f"{file.stem}.label", np.uint32)
        beam = zip(*(rays[key].tolist() for key in ("sensor", "ring", "column")), strict=True)
        rows = zip(np.load(file)[:, :3], label, strict=True)
        found |= {(file.stem, *one): row for one, row in zip(beam, rows, strict=True)}
    return found


def test_it_records_the_points_of_embree(line, recorded):
    folder, _ = recorded
    ours, other = points_of(line.dataset.folder), points_of(folder / "two")
    both = ours.keys() & other.keys()
    assert len(both) > max(10_000, 0.9995 * max(len(ours), len(other)))
    apart = np.array([np.linalg.norm(ours[beam][0] - other[beam][0]) for beam in both])
    assert np.mean(apart <= MILLIMETRE) > 0.999
    assert np.mean([ours[beam][1] == other[beam][1] for beam in both]) > 0.999


def digests(folder):
    """Return the SHA-256 of every file in a folder, as its inventory has them."""
    rows = (row.split() for row in (folder / "SHA256SUMS").read_text().splitlines())
    return {name: digest for digest, name in rows}


def test_its_bytes_depend_on_no_worker_and_on_no_package(line, recorded):
    folder, _ = recorded
    assert digests(folder / "two") == digests(folder / "bvh")
    assert json.loads((folder / "two" / "dataset.json").read_text())["backend"] == "bvh"
    assert line.dataset.manifest["backend"] == "embree"


def test_it_is_said_once(recorded):
    _, said = recorded
    (told,) = (one for one in said if "Embree" in one and not one.startswith("error"))
    assert "the package embreex is not installed" in told
    assert "tracer bvh takes over" in told
    assert [one for one in said if one.isdigit()] == ["0", "0", "0", "2"]


def test_the_same_twin_is_built(line, recorded):
    folder, _ = recorded
    for name in ("scene.npz", "rig.yaml"):
        ours, other = (place / name for place in (line.twin.folder, folder / "twin"))
        assert ours.is_file() == other.is_file()
        assert not ours.is_file() or ours.read_bytes() == other.read_bytes()


def test_coverage_is_that_of_embree(line, recorded, tmp_path, capfd):
    folder, _ = recorded
    ut.rig.coverage(line.twin, tmp_path / "with", cell=2.0, pictures=False)
    assert "Embree" not in capfd.readouterr().err
    maps = {}
    for name, place in (("with", tmp_path / "with"), ("without", folder / "map")):
        with np.load(place / "coverage.npz") as file:
            maps[name] = {key: file[key] for key in file.files}
    assert maps["with"].keys() == maps["without"].keys()
    for key, values in maps["with"].items():
        if values.dtype.kind in "fiu":
            # A beam that touches a silhouette may count in the cell before or behind it.
            same = np.isclose(values, maps["without"][key], rtol=1e-6, equal_nan=True)
            assert (~same).sum() <= 3, key  # of 1,681 cells


@pytest.mark.thorough
def test_clouds_compare_without_it(line, recorded, tmp_path):
    folder, _ = recorded
    said = run(["compare", line.dataset.folder, folder / "two", "-o", tmp_path / "report", "-q"])
    assert said[-1] == "0", said


def test_embree_asked_for_by_name_is_refused_in_a_line(recorded):
    folder, said = recorded
    (told,) = (one for one in said if one.startswith("error"))
    assert "the package embreex is not installed" in told
    assert "backend bvh" in told
    assert not (folder / "out").exists()
