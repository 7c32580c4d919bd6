"""Where `embreex` cannot be imported the built-in tracer casts every ray, and says so once."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

MILLIMETRE = 1e-3
#: Its `sitecustomize` hides the package from every process.
WITHOUT = Path(__file__).parents[1] / "without_embree"


def run(*arguments, embree=False):
    """Run a command, as a rule where Embree is missing."""
    paths = [] if embree else [str(WITHOUT)]
    paths += [one for one in [os.environ.get("PYTHONPATH")] if one]
    return subprocess.run(
        [sys.executable, "-m", "urbantwin", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.fixture(scope="module")
def recorded(line, tmp_path_factory):
    """Datasets of the same frames: by Embree; by one and two workers without it; by ``bvh``."""
    folder = tmp_path_factory.mktemp("recorded")
    common = ["record", line.twin.folder, line.motion.folder, "--stop", 0.4, "--no-pictures"]
    said = {}
    for name, embree, more in (
        ("embree", True, ["--workers", 1]),
        ("one", False, ["--workers", 1]),
        ("two", False, ["--workers", 2]),
        ("bvh", True, ["--workers", 1, "--backend", "bvh"]),
    ):
        done = run(*common, "-o", folder / name, *more, embree=embree)
        assert done.returncode == 0, done.stderr
        said[name] = done.stderr
    return folder, said


def points_of(dataset):
    """Return place and label of every point of a dataset, by frame and beam."""
    found = {}
    for file in sorted((dataset / "points").glob("*.npy")):
        rays = np.load(dataset / "rays" / file.name)
        label = np.fromfile(dataset / "semantic" / f"{file.stem}.label", np.uint32)
        beam = zip(*(rays[key].tolist() for key in ("sensor", "ring", "column")), strict=True)
        rows = zip(np.load(file)[:, :3], label, strict=True)
        found |= {(file.stem, *one): row for one, row in zip(beam, rows, strict=True)}
    return found


def test_it_records_the_points_of_embree(recorded):
    folder, _ = recorded
    ours, other = points_of(folder / "embree"), points_of(folder / "one")
    both = ours.keys() & other.keys()
    assert len(both) > max(10_000, 0.9995 * max(len(ours), len(other)))
    apart = np.array([np.linalg.norm(ours[beam][0] - other[beam][0]) for beam in both])
    assert np.mean(apart <= MILLIMETRE) > 0.999
    assert np.mean([ours[beam][1] == other[beam][1] for beam in both]) > 0.999


def digests(folder):
    """Return the SHA-256 of every file in a folder, as its inventory has them."""
    rows = (row.split() for row in (folder / "SHA256SUMS").read_text().splitlines())
    return {name: digest for digest, name in rows}


def test_its_bytes_depend_on_no_worker_and_on_no_package(recorded):
    folder, _ = recorded
    one = digests(folder / "one")
    assert one == digests(folder / "two")
    assert one == digests(folder / "bvh")
    assert json.loads((folder / "one" / "dataset.json").read_text())["backend"] == "bvh"
    assert json.loads((folder / "embree" / "dataset.json").read_text())["backend"] == "embree"


def test_it_is_said_once_and_only_where_embree_is_missing(recorded):
    _, said = recorded
    for name, times in (("embree", 0), ("one", 1), ("two", 1), ("bvh", 0)):
        lines = [line for line in said[name].splitlines() if "Embree" in line]
        assert len(lines) == times, said[name]
        assert all("the package embreex is not installed" in line for line in lines)


def test_the_same_twin_is_built(line, tmp_path):
    done = run("build", line.site, "-o", tmp_path / "twin", "--no-pictures")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("tracer bvh takes over") == 1
    for name in ("scene.npz", "rig.yaml"):
        ours, other = (folder / name for folder in (line.twin.folder, tmp_path / "twin"))
        assert ours.is_file() == other.is_file()
        assert not ours.is_file() or ours.read_bytes() == other.read_bytes()


def test_coverage_is_that_of_embree(line, tmp_path):
    maps = {}
    for name in ("with", "without"):
        common = ["coverage", line.twin.folder, "--cell", 2, "--no-pictures"]
        done = run(*common, "-o", tmp_path / name, embree=name == "with")
        assert done.returncode == 0, done.stderr
        assert ("tracer bvh takes over" in done.stderr) == (name == "without")
        with np.load(tmp_path / name / "coverage.npz") as file:
            maps[name] = {key: file[key] for key in file.files}
    assert maps["with"].keys() == maps["without"].keys()
    for key, values in maps["with"].items():
        if values.dtype.kind in "fiu":
            # A beam that touches a silhouette may count in the cell before or behind it.
            same = np.isclose(values, maps["without"][key], rtol=1e-6, equal_nan=True)
            assert same.mean() > 0.999, key


@pytest.mark.thorough
def test_clouds_compare_without_it(recorded, tmp_path):
    folder, _ = recorded
    done = run("compare", folder / "embree", folder / "one", "-o", tmp_path / "report", "-q")
    assert done.returncode == 0, done.stderr


def test_embree_asked_for_by_name_is_refused_in_a_line(line, tmp_path):
    common = ["record", line.twin.folder, line.motion.folder, "-q", "--backend", "embree"]
    done = run(*common, "-o", tmp_path / "out")
    assert done.returncode == 2
    (said,) = done.stderr.splitlines()
    assert "the package embreex is not installed" in said
    assert "backend bvh" in said
    assert not (tmp_path / "out").exists()
