import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from urbantwin.geometry import DownwardProbe, LabelledMesh, Pose
from urbantwin.geometry.rays import RayScene

TETRAHEDRON = LabelledMesh.build(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    [50, 50, 50, 40],
    7,
    [1, 1, 1, 2],
)


def test_areas_and_normals_of_a_tetrahedron():
    assert TETRAHEDRON.areas() == pytest.approx([0.5, 0.5, 0.5, np.sqrt(3) / 2])
    np.testing.assert_allclose(
        TETRAHEDRON.normals(),
        [[0, 0, -1], [0, -1, 0], [-1, 0, 0], np.ones(3) / np.sqrt(3)],
        atol=1e-12,
    )


def test_joining_selecting_and_moving_keep_the_labels(tmp_path):
    moved = TETRAHEDRON.transformed(Pose.from_ypr([10, 0, 0], yaw=1.0))
    both = LabelledMesh.concatenate([TETRAHEDRON, LabelledMesh.empty(), moved])
    assert len(both.faces) == 8
    one = both.select(both.semantic == 40)
    assert (len(one.faces), len(one.vertices)) == (2, 6)
    np.testing.assert_allclose(one.areas(), np.sqrt(3) / 2)
    assert one.part.tolist() == [2, 2]
    both.save(tmp_path / "a.npz")
    again = LabelledMesh.load(tmp_path / "a.npz")
    for name in ("vertices", "faces", "semantic", "material", "part"):
        np.testing.assert_array_equal(getattr(again, name), getattr(both, name))


def test_shapes_are_checked():
    with pytest.raises(ValueError, match=r"semantic must be \(1,\)"):
        LabelledMesh(
            np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32), np.zeros(2, np.uint16),
            np.zeros(1, np.uint8), np.zeros(1, np.int32),
        )  # fmt: skip


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-50, 50))
def test_heights_of_a_sloping_plane(east, north, rise):
    corners = np.array([[-100.0, -100], [100, -100], [100, 100], [-100, 100]])
    z = corners @ [east, north] + rise
    plane = LabelledMesh.build(np.column_stack([corners, z]), [[0, 1, 2], [0, 2, 3]], 40, 1)
    points = np.random.default_rng(0).uniform(-99, 99, (20, 2))
    found = DownwardProbe(plane).height_below(np.column_stack([points, np.full(20, 500.0)]))
    np.testing.assert_allclose(found, points @ [east, north] + rise, atol=1e-9)


def test_the_first_surface_below_counts_and_nothing_above():
    corners = [[-1, -1], [1, -1], [0, 2]]
    floors = LabelledMesh.concatenate(
        LabelledMesh.build(np.column_stack([corners, np.full(3, z)]), [[0, 1, 2]], 40, 1)
        for z in (0.0, 3.0)
    )
    probe = DownwardProbe(floors)
    assert probe.height_below([[0, 0, 5], [0, 0, 2]]) == pytest.approx([3.0, 0.0])
    assert np.isnan(probe.height_below([[0, 0, -1], [5, 5, 5]])).all()


@pytest.mark.parametrize("beside", [False, True])
def test_rays_meet_a_floor_where_geometry_says(beside):
    floor = RayScene(
        np.array([[-1e3, -1e3, 0], [1e3, -1e3, 0], [0, 1e3, 0.0]]), np.array([[0, 1, 2]])
    )
    slope = np.linspace(-1.2, 1.2, 1003)  # not a multiple of a packet's rays; level is missed
    ways = np.column_stack([np.cos(slope), np.zeros(1003), np.sin(slope)])
    hits = floor.cast_single(np.broadcast_to([0.0, 0.0, 5.0], ways.shape), ways, beside=beside)
    down = slope < -np.arcsin(5 / 400)
    np.testing.assert_allclose(hits.range_m[down], -5 / ways[down, 2], rtol=1e-5)
    assert (hits.face[down] == 0).all()
    assert (hits.face[slope >= 0] == -1).all()
    assert np.isinf(hits.range_m[slope >= 0]).all()
