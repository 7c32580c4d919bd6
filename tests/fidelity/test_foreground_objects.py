"""Objects among the points that move, against bodies that were put there."""

import numpy as np

from urbantwin.fidelity.foreground_objects import (
    foreground_objects,
    object_divergences,
    objects_of,
)
from urbantwin.reconstruct.recording.recorded_ground import recorded_ground


def body(rng, place, size, count):
    """Points (N, 3) throughout an upright box that stands at a place."""
    return np.array(place) + (rng.random((count, 3)) - [0.5, 0.5, 0.0]) * size


def street(rng):
    level = np.column_stack([rng.uniform(-20, 20, (9000, 2)), rng.normal(-1.8, 0.01, 9000)])
    return recorded_ground(level)


def test_bodies_are_told_by_size_shape_and_points():
    rng = np.random.default_rng(3)
    ground = street(rng)
    car = body(rng, (5, 5, -1.8), (4.5, 1.8, 1.5), 4000)
    post = body(rng, (-6, 2, -1.8), (0.02, 0.02, 2.0), 300)
    wall = body(rng, (-8, -9, -1.8), (2.0, 0.02, 2.0), 900)
    leaves = body(rng, (9, -9, 0.5), (2.0, 2.0, 2.0), 900)
    found = objects_of(np.concatenate([car, post, wall, leaves]), ground)
    assert len(found) == 3  # leaves hang
    by_length = found[np.argsort(found[:, 0])]
    np.testing.assert_allclose(by_length[:, 0], [0.02, 2.0, 4.5], atol=0.1)
    np.testing.assert_allclose(by_length[:, 1], [0.02, 0.02, 1.8], atol=0.1)
    # What is nearer to the ground than 0.3 m is the ground's.
    np.testing.assert_allclose(by_length[:, 2], [1.7, 1.7, 1.2], atol=0.08)
    line, plane = by_length[:, 3], by_length[:, 4]
    # Deviations of a uniform body go as its sides: of a post one, of a wall two.
    assert line[0] > 0.95
    assert plane[1] > 0.8
    np.testing.assert_allclose(line[2], 1 - 1.8 / 4.5, atol=0.03)
    assert by_length[0, 5] < by_length[1, 5] < by_length[2, 5] < 4000


def test_the_same_objects_differ_by_nothing_and_others_altogether():
    rng = np.random.default_rng(5)
    sizes = [rng.normal(4.4, 0.1, 50), rng.normal(1.8, 0.05, 50), np.full(50, 1.4)]
    cars = np.column_stack([*sizes, *rng.random((2, 50)), np.full(50, 600.0)])
    people = np.column_stack([np.full((50, 2), 0.4), np.full(50, 1.7), *rng.random((2, 50))])
    people = np.column_stack([people, np.full(50, 20.0)])
    assert object_divergences(cars, cars) == {"size": 0.0, "shape": 0.0, "points": 0.0}
    other = object_divergences(cars, people)
    assert other["size"] == other["points"] == 1.0
    assert object_divergences(cars, people[:0])["size"] is None


def test_one_real_frame_has_no_halves_to_compare():
    rng = np.random.default_rng(7)
    rows = np.column_stack([rng.uniform(0.5, 5, (30, 3)), rng.random((30, 2)), np.full(30, 99.0)])
    told = foreground_objects({"real": [rows], "synthetic": [rows[:10], rows[10:]]})
    assert told["objects_per_frame"] == {"real": 30.0, "synthetic": 15.0}
    assert told["js_twin"]["size"] == 0.0
    assert told["js_real_against_real"]["size"] is None
    assert told["ratio_to_real"]["size"] is None
    assert foreground_objects({"real": [rows]}) is None
