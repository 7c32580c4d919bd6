import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box

from urbantwin.scene.building_shell import ShellPlan
from urbantwin.scene.extrusion import Body, clean_polygons, triangulate
from urbantwin.scene.solids import Solid

COURTYARD = Polygon(
    [(0, 0), (20, 0), (20, 10), (0, 10)],
    [[(5, 3), (5, 7), (9, 7), (9, 3)], [(12, 2), (15, 5), (12, 8)]],
)


def extrude(bodies) -> Solid:
    return ShellPlan(bodies).build().solid


def prism(footprint, low, high) -> Solid:
    return extrude([Body(footprint, low, high)])


def edge_balance(solid: Solid) -> int:
    """Return by how much the most uneven edge's two directions differ: 0 for a closed surface."""
    ends = solid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    sign = np.where(ends[:, 0] < ends[:, 1], 1, -1)
    _, edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    return int(np.abs(np.bincount(edge.ravel(), weights=sign)).max())


def faces_per_edge(solid: Solid) -> set[int]:
    ends = np.sort(solid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return set(np.unique(ends, axis=0, return_counts=True)[1].tolist())


def test_triangles_cover_a_polygon_with_holes_exactly():
    vertices, faces = triangulate(COURTYARD)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(COURTYARD.area)
    assert len(vertices) == 4 + 4 + 3


def test_a_prism_has_the_volume_of_area_times_height_and_is_closed():
    solid = prism(COURTYARD, -0.5, 12.0)
    assert solid.volume() == pytest.approx(COURTYARD.area * 12.5)
    assert faces_per_edge(solid) == {2}
    assert edge_balance(solid) == 0


def test_the_way_a_ring_is_drawn_does_not_matter():
    clockwise = Polygon([(0, 0), (0, 2), (3, 2), (3, 0)])
    assert prism(clockwise, 0, 1).volume() == pytest.approx(6)


def test_a_courtyard_that_touches_the_outline_stays_closed():
    touching = Polygon([(0, 0), (10, 0), (10, 10), (0, 10)], [[(0, 5), (4, 3), (4, 7)]])
    solid = prism(touching, 0, 5)
    assert faces_per_edge(solid) == {2}
    assert solid.volume() == pytest.approx(touching.area * 5, rel=0.01)


def test_prisms_side_by_side_and_on_top_of_each_other_become_one_surface():
    bodies = [
        Body(box(0, 0, 10, 10), 0, 5),
        Body(box(10, 0, 20, 10), 0, 12),
        Body(box(2, 2, 6, 6), 5, 20),
        Body(box(20, 4, 26, 6), 3, 6),
    ]
    solid = extrude(bodies)
    assert solid.volume() == pytest.approx(500 + 1200 + 4 * 4 * 15 + 12 * 3)
    assert faces_per_edge(solid) == {2}
    assert edge_balance(solid) == 0
    roofs = solid.rises() > 0.5
    a, b, c = np.moveaxis(solid.vertices[solid.faces[roofs]], 1, 0)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(212)


def test_bodies_that_touch_along_an_edge_have_two_faces_on_it_each():
    corner_to_corner = [Body(box(0, 0, 4, 4), 0, 5), Body(box(4, 4, 8, 8), 0, 5)]
    solid = extrude([*corner_to_corner, Body(box(4, 0, 8, 4), 0, 2)])
    assert solid.volume() == pytest.approx(160 + 32)
    assert faces_per_edge(solid) == {2}
    assert edge_balance(solid) == 0


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.integers(0, 12)] * 2, *[st.integers(1, 7)] * 2, *[st.integers(1, 6)] * 2),
        min_size=1,
        max_size=6,
    )
)
def test_a_union_of_boxes_has_the_volume_counted_cell_by_cell(boxes):
    bodies, filled = [], np.zeros((20, 20, 20), bool)
    for x, y, width, depth, low, high in boxes:
        bodies.append(Body(box(x, y, x + width, y + depth), low, low + high))
        filled[x : x + width, y : y + depth, low : low + high] = True
    solid = extrude(bodies)
    assert solid.volume() == pytest.approx(filled.sum())
    assert edge_balance(solid) == 0
    assert faces_per_edge(solid) == {2}


def test_overlapping_oblique_bodies_match_a_sampled_volume():
    rng = np.random.default_rng(7)
    bodies = [
        Body(shapely.affinity.rotate(box(x, y, x + 8, y + 5), angle), low, low + 6)
        for x, y, angle, low in [(0, 0, 20, 0), (3, 1, 75, 3), (-2, 4, -40, 1)]
    ]
    points = rng.uniform([-10, -10, 0], [16, 16, 9], (200_000, 3))
    inside = np.zeros(len(points), bool)
    for body in bodies:
        within = shapely.contains_xy(body.footprint, points[:, 0], points[:, 1])
        inside |= within & (points[:, 2] >= body.low) & (points[:, 2] <= body.high)
    solid = extrude(bodies)
    assert solid.volume() == pytest.approx(inside.mean() * 26 * 26 * 9, rel=0.02)
    assert edge_balance(solid) == 0


def test_footprints_that_cross_themselves_are_repaired_and_slivers_dropped():
    bow_tie = Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])
    pieces = clean_polygons(bow_tie)
    assert all(piece.is_valid for piece in pieces)
    assert sum(piece.area for piece in pieces) == pytest.approx(50)
    assert clean_polygons(box(0, 0, 50, 0.05)) == []
    assert clean_polygons(shapely.LineString([(0, 0), (5, 5)])) == []
    assert clean_polygons(Polygon([(0, 0), (1, 1), (2, 2)])) == []


def test_a_courtyard_that_touches_at_a_corner_stays_closed():
    touching = Polygon([(0, 0), (10, 0), (10, 10), (0, 10)], [[(0, 0), (4, 2), (2, 4)]])
    solid = prism(touching, 0, 5)
    assert faces_per_edge(solid) == {2}
    assert solid.volume() == pytest.approx(touching.area * 5, rel=0.01)
