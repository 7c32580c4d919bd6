import math

import numpy as np
import pytest

from urbantwin.scene.solids import Assembly, box, columns, rods, sweep
from urbantwin.taxonomy import material_id, semantic_id


def faces_per_edge(solid):
    ends = np.sort(solid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return set(np.unique(ends, axis=0, return_counts=True)[1].tolist())


def polygon_share(sides):
    """Return the area of a regular polygon over that of the circle around it."""
    return sides * math.sin(2 * math.pi / sides) / (2 * math.pi)


def test_boxes_have_their_volume_and_are_closed():
    solid = box([[1, 2, 3], [10, 0, 0]], [[2, 3, 4], [1, 1, 1]], [0.3, -2])
    assert solid.volume() == pytest.approx(25)
    assert faces_per_edge(solid) == {2}


def test_a_turned_box_has_its_length_along_its_yaw():
    vertices = box([0, 0, 0], [4, 2, 1], math.pi / 2).vertices
    assert np.ptp(vertices, axis=0) == pytest.approx([2, 4, 1])


@pytest.mark.parametrize("end", [(0, 0, 5), (3, 4, 0), (0, 0, -5), (3, 0, 4)])
def test_rods_are_cylinders_in_every_direction(end):
    solid = rods([[0, 0, 0]], [end], 0.5, 0.5, 12)
    assert solid.volume() == pytest.approx(math.pi * 0.25 * 5 * polygon_share(12))
    assert faces_per_edge(solid) == {2}


def test_tapered_columns_are_frustums():
    solid = columns([[0, 0, 1], [5, 5, 0]], [6, 3], [1, 1], [0.5, 0.5], 10)
    frustum = math.pi / 3 * (1 + 0.5 + 0.25) * polygon_share(10)
    assert solid.volume() == pytest.approx(frustum * 9)
    assert faces_per_edge(solid) == {2}


@pytest.mark.parametrize("closed", [False, True])
def test_a_profile_swept_round_corners_keeps_its_width(closed):
    path = [[0, 0, 2], [10, 0, 2], [10, 10, 2], [0, 10, 2]]
    profile = [(0.1, 0), (-0.1, 0), (-0.1, 2), (0.1, 2)]
    solid = sweep(path, profile, closed=closed)
    # Centre lines of constant width enclose length x width, mitred corners included.
    assert solid.volume() == pytest.approx((40 if closed else 30) * 0.2 * 2)
    assert faces_per_edge(solid) == {2}


def test_an_assembly_keeps_labels_with_their_solids():
    assembly = Assembly()
    first, second = assembly.new_part(), assembly.new_part()
    assembly.add(box([0, 0, 0], [1, 1, 1]), "building", "brick", first)
    assembly.add(box([5, 0, 0], [1, 1, 1]), "pole", "wood", second)
    mesh = assembly.mesh()
    near = mesh.triangles()[..., 0].mean(axis=1) < 2
    assert set(mesh.part[near]) == {1}
    assert set(mesh.semantic[~near]) == {semantic_id("pole")}
    assert set(mesh.material[near]) == {material_id("brick")}
    assert mesh.faces.max() == 15
