"""An exact copy of a recording is nearer to it than anything else, on every measure of a report."""

import importlib
import shutil

import numpy as np
import pytest

from urbantwin.fidelity import compare
from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.report import anchored

FRAMES, RINGS, COLUMNS = 3, 32, 720
CAR_M = (4.4, 1.8, 1.5)


def cars_in(index):
    """Return where the two cars stand in a frame, metres."""
    return (-9 + 3 * index, 6), (22 - 5 * index, -8)


def street_frame(index):
    """Return points, instances and rays of a sensor 3 m over a walled square with two cars.

    Ranges have 2 cm of noise, one beam in twenty does not return, and the cars drive on.
    """
    rng = np.random.default_rng(index)
    ring, column = (grid.ravel() for grid in np.indices((RINGS, COLUMNS)))
    azimuth, elevation = column * (2 * np.pi / COLUMNS), np.radians(ring * 1.5 - 35.0)
    beam = np.column_stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    with np.errstate(divide="ignore"):
        distance = np.minimum(
            (30.0 / np.abs(beam[:, :2])).min(axis=1),
            np.where(beam[:, 2] < 0, -3.0 / beam[:, 2], np.inf),
        )
        instance = np.zeros(len(beam), np.int64)
        for track, (x, y) in enumerate(cars_in(index), 1):
            low = np.array([x, y, -3.0]) - [CAR_M[0] / 2, CAR_M[1] / 2, 0]
            faces = np.stack([low, low + CAR_M]) / beam[:, None]
            enter, leave = faces.min(axis=1).max(axis=1), faces.max(axis=1).min(axis=1)
            hit = (enter < leave) & (enter > 0) & (enter < distance)
            distance[hit], instance[hit] = enter[hit], track
    points = beam * (distance + rng.normal(0, 0.02, len(beam)))[:, None]
    intensity = np.clip(0.3 + 0.2 * (instance > 0) + rng.normal(0, 0.05, len(beam)), 0, 1)
    kept = rng.random(len(beam)) < 0.95
    rays = np.zeros(
        len(beam),
        [("sensor", "u1"), ("ring", "<u2"), ("column", "<u2"), ("time", "<f4"), ("echo", "u1")],
    )
    rays["ring"], rays["column"] = ring, column
    return np.column_stack([points, intensity])[kept].astype("<f4"), instance[kept], rays[kept]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A dataset with everything that a measure can look at: labels, beams and intensity."""
    path = tmp_path_factory.mktemp("copied") / "real"
    for name in ("points", "semantic", "rays", "labels"):
        (path / name).mkdir(parents=True)
    for index in range(FRAMES):
        points, instance, rays = street_frame(index)
        assert len(points) > 20_000  # more than any measure looks at
        np.save(path / f"points/{index:06}.npy", points)
        np.save(path / f"rays/{index:06}.npy", rays)
        (instance << 16 | (instance > 0)).astype("<u4").tofile(path / f"semantic/{index:06}.label")
        lines = [f"{x} {y} -2.25 4.4 1.8 1.5 0 car\n" for x, y in cars_in(index)]
        (path / f"labels/{index:06}.txt").write_text("".join(lines))
    return path


@pytest.fixture(scope="module")
def report(recording, tmp_path_factory):
    root = tmp_path_factory.mktemp("compared")
    copy = shutil.copytree(recording, root / "copy")
    with pytest.MonkeyPatch.context() as patch:  # the page has a test of its own
        patch.setattr(importlib.import_module("urbantwin.fidelity.compare"), "_WORST", 1)
        return compare(
            *(recording, copy, root / "report"),
            **{"arbitrary": None, "protocol": "urbantwin-challenge", "workers": 1},
        )


@pytest.mark.thorough
@pytest.mark.parametrize("part", ["whole", "foreground", "background"])
def test_a_copy_is_nearer_than_the_next_real_frame_on_every_measure(report, part):
    rows = [(f.twin_figures, f.real_figures) for f in report.frames]
    if part != "whole":
        rows = [tuple(f.parts[part].get(side) for side in ("twin", "real")) for f in report.frames]
    rows = rows[:-1]  # the last frame has no next one
    assert all(real is not None for _, real in rows)
    for copy, real in rows:
        # Parts have no measure of samples and none of beams; whole frames have all.
        assert copy.keys() == real.keys()
        assert part != "whole" or copy.keys() == MEASURES.keys()
        for name, value in copy.items():
            assert value < 0.3 * real[name], name
            if not name.startswith("point_to_mesh"):
                assert value == pytest.approx(0, abs=1e-9), name
    ratio = anchored([a for a, _ in rows], [], [b for _, b in rows]).ratio_to_real
    assert all(ratio[name] < 0.3 for name in rows[0][0])


def test_a_copy_is_nearer_to_the_rebuilt_surface_than_the_points_held_out(report):
    for frame in report.frames:
        for name in ("mean", "median", "p95"):
            figure = frame.twin_figures[f"point_to_mesh_{name}_m"]
            # Nine of ten points are the surface's own vertices.
            assert figure < 0.5 * frame.rebuild[f"held_out_{name}_m"], name


def test_a_copy_has_the_objects_and_lacks_no_surface(report):
    assert report.missing == []
    assert report.doubts == []
    differences = report.objects["synthetic_against_real"]
    assert differences["class_mix_js"] == differences["heat_map_js"] == 0
    assert (
        differences["boxes_per_frame_ratio"] == differences["classes"]["car"]["points_ratio"] == 1
    )
    assert set(differences["classes"]["car"]["dimensions"].values()) == {0.0}


def test_a_copy_scores_above_real_frames_in_the_challenge(report):
    scores = report.protocol["scores"]
    copy, real = scores["twin"], scores["real_against_real"]
    for name, value in copy["raw"].items():
        assert value == pytest.approx(0, abs=1e-9), name
        assert real["raw"][name] > 1e-4, name
    assert copy["realism"] > real["realism"]
