"""Actors that stand before a sensor that stands are cast at only once, and met as if anew."""

import numpy as np
import pytest

from urbantwin.geometry import Pose
from urbantwin.lidar import Scanner
from urbantwin.lidar.casting.processor import ProcessorTracer

from ..thorough import further


def same(one, other):
    arrays = ("points", "semantic", "instance", "ring", "column", "time_s", "echo")
    boxes = [
        [(b.track, b.box.tolist(), b.num_points, b.num_points_alone, b.observed_s) for b in f.boxes]
        for f in (one, other)
    ]
    return boxes[0] == boxes[1] and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays
    )


@pytest.fixture
def cast_at(monkeypatch):
    """How many actors were cast at, call by call."""
    counts = []
    layers = ProcessorTracer.layers

    def counted(self, firing, actors, blocks, casting):
        counts.append(len(actors.shape))
        return layers(self, firing, actors, blocks, casting)

    monkeypatch.setattr(ProcessorTracer, "layers", counted)
    return counts


def moments(crowd):
    """Frames of a crowd of which two thirds stand: one of those is put elsewhere, and stays."""
    actors = crowd(30, seed=3)
    standing = actors[:20]  # all of them do
    driving = [one._replace(velocity=np.array([5.0, 1.0, 0.0])) for one in actors[20:]]
    moved = standing[4]._replace(
        site_SE3_asset=Pose(
            standing[4].site_SE3_asset.rotation,
            standing[4].site_SE3_asset.translation + [0.0, 1e-9, 0.0],
        ),
    )
    later = [*standing[:4], moved, *standing[5:]]
    return [standing + driving, standing + driving, later + driving, later + driving, driving]


@pytest.mark.parametrize("effects", [True, *further(False)])
def test_frames_are_those_of_scanners_that_know_nothing(street, rig_of, crowd, cast_at, effects):
    rig = rig_of(street, {"columns": 512, "effects": effects})
    frames = moments(crowd)
    expected = [Scanner(street, rig, 5).scan(7, actors) for actors in frames]
    scanner = Scanner(street, rig, 5)
    cast_at.clear()
    for actors, one in zip(frames, expected, strict=True):
        assert same(scanner.scan(7, actors), one)
    assert cast_at == [30, 10, 11, 10, 10]


@pytest.mark.parametrize("one", [{"sway": {"rms_m": 0.05}}, *further({"time_jitter_s": 0.002})])
def test_beams_that_fire_at_other_times_or_from_elsewhere_are_cast(
    street, rig_of, crowd, cast_at, one
):
    rig = rig_of(street, {"columns": 512, **one})
    frames = moments(crowd)
    expected = [Scanner(street, rig, 5).scan(k, actors) for k, actors in enumerate(frames)]
    scanner = Scanner(street, rig, 5)
    cast_at.clear()
    for k, actors in enumerate(frames):
        assert same(scanner.scan(k, actors), expected[k])
    street_apart = [count for count in cast_at if count > 1]
    assert street_apart == [30, 30, 30, 30, 10]
