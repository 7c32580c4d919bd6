import numpy as np
import pytest

from urbantwin.ground import Elevation


def grid(height, step=1.0, half=60.0):
    axis = np.arange(-half, half + step, step)
    x, y = np.meshgrid(axis, axis)
    return Elevation(-half, -half, step, height(x, y))


@pytest.mark.parametrize("step", [1.0, 2.5])
def test_a_plane_stays_the_plane(step):
    plane = grid(lambda x, y: 0.03 * x - 0.05 * y + 2.0, step)
    points = np.random.default_rng(1).uniform(-30, 30, (200, 2))
    expected = points @ [0.03, -0.05] + 2.0
    np.testing.assert_allclose(plane.raw_at(points), expected, atol=1e-9)


def test_beyond_the_grid_the_border_goes_on():
    plane = grid(lambda x, y: 0.1 * x)
    assert plane.raw_at([[1000.0, 0.0]])[0] == pytest.approx(6.0)


def test_saving_keeps_every_height(tmp_path):
    ground = grid(lambda x, y: np.sin(x / 7) * y / 10)
    ground.save(tmp_path / "a.npz")
    ground.save(tmp_path / "b.npz")
    again = Elevation.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.raw, ground.raw)
    assert (again.west, again.south, again.step) == (-60.0, -60.0, 1.0)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
