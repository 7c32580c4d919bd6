"""Measures of whole distributions, against closed forms and other programs."""

import numpy as np
import open3d as o3d
import pytest
from scipy.linalg import sqrtm
from scipy.stats import wasserstein_distance

from urbantwin.fidelity.cloud_distances import (
    chamfer,
    chamfer_squared,
    density_chamfer,
    earth_mover,
    frechet,
    frechet_places,
    frechet_shapes,
    mean_discrepancy,
    shape_features,
    sliced_earth_mover,
)
from urbantwin.fidelity.nearest_point import nearest_distances


def cloud(seed=0, count=800, spread=(20.0, 20.0, 3.0)):
    return np.random.default_rng(seed).normal(size=(count, 3)) * spread


def test_chamfer_of_parallel_lines():
    line = np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50)])
    found = nearest_distances(line, line + [0, 0.3, 0])
    assert chamfer(found) == pytest.approx(0.3)
    assert chamfer_squared(found) == pytest.approx(2 * 0.09)
    # One way only: half of a line is all on the other.
    found = nearest_distances(line, line[:25])
    assert chamfer(found) == pytest.approx(np.arange(1, 26).sum() / 50 / 2)


def test_chamfer_agrees_with_open3d():
    a, b = cloud(1), cloud(2, 500)
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(x)) for x in (a, b)]
    there, back = (np.asarray(p.compute_point_cloud_distance(q)) for p, q in (clouds, clouds[::-1]))
    found = nearest_distances(a, b)
    assert chamfer(found) == pytest.approx((there.mean() + back.mean()) / 2)
    assert chamfer_squared(found) == pytest.approx((there**2).mean() + (back**2).mean())


def test_density_chamfer_in_closed_form():
    grid = np.array([[x, y, 0.0] for x in range(0, 100, 10) for y in range(0, 100, 10)])
    assert density_chamfer(grid, grid) == 0
    # Every point has its own neighbour 0.5 m away.
    assert density_chamfer(grid, grid + [0, 0, 0.5]) == pytest.approx(1 - np.exp(-0.5))
    # All points of one cloud on one point of the other: 100 share it, and the other 99 are far.
    pile = np.repeat(grid[:1], 100, axis=0)
    far = np.exp(-np.linalg.norm(grid - grid[0], axis=1))
    expected = ((1 - 1 / 100) + (1 - far / 100).mean()) / 2
    assert density_chamfer(grid, pile) == pytest.approx(expected, abs=1e-3)
    # The plain distance of a cloud to its own denser half does not grow with crowding.
    assert density_chamfer(grid, grid + 1e6) == pytest.approx(1)


def test_earth_mover_of_a_moved_cloud_is_the_move():
    a = cloud()
    assert earth_mover(a, a + [0.3, 0.4, 0]) == pytest.approx(0.5)
    assert earth_mover(a, a) == 0
    # Onto a line, the assignment is the one of the sorted values (scipy's own).
    x, y = cloud(3, 300) * [1, 0, 0], cloud(4, 300) * [1, 0, 0] + [5, 0, 0]
    assert earth_mover(x, y) == pytest.approx(wasserstein_distance(x[:, 0], y[:, 0]))


def test_sliced_distance_of_a_moved_cloud_is_half_the_move():
    # The mean of |cos| over the sphere is 1/2: here over 64 directions, so about.
    a = cloud()
    moves = [sliced_earth_mover(a, a + move) for move in ([6, 0, 0], [0, 6, 0], [0, 0, 6])]
    assert np.mean(moves) == pytest.approx(3, rel=0.1)
    assert sliced_earth_mover(a, a) == 0
    b = cloud(7)
    assert sliced_earth_mover(a, b) <= earth_mover(a, b)


def test_mean_discrepancy_of_two_places():
    # All points of a cloud in one place: k(x, x') = 1, and across exp(-d^2 / 2 sigma^2).
    a, b = np.zeros((50, 3)), np.tile([3.0, 4.0, 0.0], (50, 1))
    across = np.mean([np.exp(-25 / (2 * s * s)) for s in (1.0, 4.0, 16.0)])
    assert mean_discrepancy(a, b) == pytest.approx(2 - 2 * across)
    assert mean_discrepancy(a, a) == 0
    assert mean_discrepancy(a, b + 1e4) == pytest.approx(2)


def test_mean_discrepancy_of_two_normal_clouds():
    # Of N(0, 1) and N(m, 1) in each axis with one Gaussian kernel there is a closed form:
    # 2 (s^2 / (s^2 + 2))^(3/2) (1 - exp(-|m|^2 / (2 (s^2 + 2)))).
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(1500, 3)), rng.normal(size=(1500, 3)) + [2, 0, 0]
    expected = 2 * (4 / 6) ** 1.5 * (1 - np.exp(-4 / 12))
    assert mean_discrepancy(a, b, widths_m=(2.0,)) == pytest.approx(expected, rel=0.05)


def test_frechet_in_closed_form_and_by_a_matrix_root():
    zero, one = np.zeros(3), np.eye(3)
    assert frechet(zero, one, zero, one) == pytest.approx(0, abs=1e-12)
    assert frechet(zero, one, np.array([1.0, 2, 2]), one) == pytest.approx(9)
    # Of covariances that commute: the squared differences of the deviations.
    assert frechet(zero, np.diag([1.0, 4, 9]), zero, np.diag([4.0, 4, 0])) == pytest.approx(10)
    rng = np.random.default_rng(0)
    for _ in range(5):
        p, q = (rng.normal(size=(3, 3)) for _ in range(2))
        p, q = p @ p.T, q @ q.T
        expected = np.trace(p + q - 2 * np.real(sqrtm(p @ q)))
        assert frechet(zero, p, zero, q) == pytest.approx(expected, abs=1e-7)


def test_an_affine_map_fools_places_but_not_shapes():
    rng = np.random.default_rng(1)

    def corner():
        flat = np.column_stack([rng.uniform(-20, 20, (4000, 2)), np.zeros(4000)])
        x, z = rng.uniform([-20, 0], [20, 8], (4000, 2)).T
        return np.concatenate([flat, np.column_stack([x, np.full(4000, 5.0), z])])

    street = corner()
    noise = rng.normal(size=street.shape) @ np.linalg.cholesky(np.cov(street, rowvar=False)).T
    noise += street.mean(axis=0) - noise.mean(axis=0)
    assert frechet_places(street, noise) < 0.5
    assert frechet_places(street, street + [1, 2, 2]) == pytest.approx(9)
    assert frechet_shapes(street, noise) > 50 * frechet_shapes(street, corner())
    assert frechet_shapes(street[:10], noise) is None


def test_shapes_of_line_plane_and_ball():
    rng = np.random.default_rng(2)
    line = np.column_stack([np.arange(500) * 0.1, np.zeros((500, 2))])
    linearity, planarity, scattering = shape_features(line)[:, :3].mean(axis=0)
    assert (linearity, planarity, scattering) == pytest.approx((1, 0, 0), abs=1e-6)
    # On a line of points 0.1 m apart 16 neighbours lie 0.1 to 0.8 m away, twice each.
    assert np.median(shape_features(line)[:, 4]) == pytest.approx(np.log(0.45))
    floor = np.column_stack([rng.uniform(0, 9, (3000, 2)), np.zeros(3000)])
    found = shape_features(floor)
    assert found[:, 2] == pytest.approx(0, abs=1e-6)
    assert found[:, 3] == pytest.approx(0, abs=1e-6)
    assert shape_features(floor[:, [0, 2, 1]])[:, 3] == pytest.approx(1)
    assert shape_features(rng.normal(size=(3000, 3)))[:, 2].mean() > 0.4
