"""Clutter set into frames: beams end where they first meet it, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

pytest.importorskip("torch", reason="torch is not installed: pip install 'urbantwin[detector]'")

from urbantwin.learn.augmentation import Obstacles, cluttered, with_obstacles
from urbantwin.learn.frames import LevelFrame
from urbantwin.learn.heads import class_heads
from urbantwin.learn.sample import Varied, sample_of


def frame_of(points: np.ndarray, sensors: np.ndarray, ring: np.ndarray) -> LevelFrame:
    """A frame with one car at (12, -5)."""
    car = np.array([[12.0, -5.0, 0.8, 4.5, 1.8, 1.6, 0.3]])
    return LevelFrame(
        points.astype(np.float32), ring.astype(np.int32), np.zeros(len(points), np.uint8), sensors,
        car, np.zeros(1, np.int64), np.ones((1, 1), bool),
    )  # fmt: skip


def beams(draw: np.random.Generator, count: int = 8000) -> np.ndarray:
    """Points all around, at the ground and above."""
    around, far = draw.uniform(-np.pi, np.pi, count), draw.uniform(5, 40, count)
    return np.column_stack([far * np.cos(around), far * np.sin(around), draw.uniform(0, 4, count)])


def test_beams_end_where_a_ray_tracer_says() -> None:
    draw = np.random.default_rng(3)
    sensors = np.array([[0.0, 0.0, 1.7], [30.0, 2.0, 6.0]])
    points, ring = beams(draw), draw.integers(0, 2, 8000) * 4096
    stands = Obstacles(
        middle=np.array([[8.0, 3.0, 0.9], [-6.0, -9.0, 1.0]]),
        half=np.array([[1.5, 0.4, 0.9], [1.2, 2.0, 1.3]]),
        yaw=np.array([0.7, -1.1]),
        is_round=np.array([False, True]),
        depth=np.zeros(2),
    )
    found = with_obstacles(frame_of(points, sensors, ring), stands, np.random.default_rng(1)).points

    solids = []
    for k, solid in enumerate((trimesh.creation.box((2, 2, 2)), trimesh.creation.icosphere(5))):
        solid.apply_scale(stands.half[k])
        solid.apply_transform(trimesh.transformations.rotation_matrix(stands.yaw[k], [0, 0, 1]))
        solid.apply_translation(stands.middle[k])
        solids.append(solid)
    world = trimesh.util.concatenate(solids)
    start = sensors[ring // 4096]
    way = points - start
    far = np.linalg.norm(way, axis=1)
    at, beam, _ = world.ray.intersects_location(start, way / far[:, None], multiple_hits=False)
    wanted = far.copy()
    wanted[beam] = np.minimum(far[beam], np.linalg.norm(at - start[beam], axis=1))
    ends = np.linalg.norm(found - start, axis=1)
    assert (wanted < far - 0.2).sum() > 100
    off = np.abs(ends - wanted)
    assert np.mean(off > 0.15) < 2e-3  # the tracer's ball has facets: a grazing beam passes
    assert np.linalg.norm(np.cross(found - start, way / far[:, None]), axis=1).max() < 1e-3


def test_plants_let_beams_in_and_nothing_stands_in_a_box() -> None:
    points = beams(np.random.default_rng(4))
    frame = frame_of(points, np.array([[0.0, 0.0, 1.7]]), np.zeros(len(points)))
    hedge = Obstacles(
        np.array([[10.0, 0.0, 2.0]]), np.array([[1.0, 9.0, 2.0]]), np.zeros(1),
        np.zeros(1, bool), np.array([0.3]),
    )  # fmt: skip
    found = with_obstacles(frame, hedge, np.random.default_rng(2)).points
    moved = np.linalg.norm(found - frame.points, axis=1) > 0.2
    inside = np.abs(found[moved, 0] - 10) < 1.1
    assert inside.mean() > 0.95
    assert np.ptp(found[moved, 0]) > 0.8
    beside = points.copy()
    beside[:, :2] = frame.box[0, :2] + beside[:, :2] / 20
    near = frame_of(beside, np.array([[0.0, 0.0, 1.7]]), np.zeros(len(beside)))
    for seed in range(6):
        car = cluttered(near, (12.0, -5.0, 4.0), np.random.default_rng(seed)).points
        shifted = np.linalg.norm(car - near.points, axis=1) > 0.1
        c, s = np.cos(0.3), np.sin(0.3)
        x, y = (car[shifted, :2] - frame.box[0, :2]).T
        assert not ((np.abs(c * x + s * y) < 2.2) & (np.abs(c * y - s * x) < 0.8)).any()


@pytest.mark.thorough
def test_a_person_of_four_points_is_neither_right_nor_wrong_and_one_of_five_is_asked_for() -> None:
    nothing = Varied(placed=False, beams=False, objects=False, sizes=False, clutter=False)
    for held in (4, 5):
        points = np.zeros((held, 3))
        points[:, 0], points[:, 2] = 6.0, np.linspace(0.4, 1.6, held)
        frame = replace(
            frame_of(points, np.array([[0.0, 0.0, 1.7]]), np.zeros(held)),
            box=np.array([[6.0, 0.0, 0.9, 0.6, 0.6, 1.8, 0.0]]),
        )
        sample = sample_of(
            frame, 24.0, 0.5, class_heads(("pedestrian",)), np.random.default_rng(0), varied=nothing
        )
        assert sample.targets[0].objects == (held == 5)
        assert (sample.targets[0].counts.min() == 0) == (held == 4)
