import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon, box

from urbantwin.scene.barrier import barrier_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

from ..thin_rays import cast_static

REGION = box(-100, -100, 100, 100)
NO_ROAD = Polygon()


def tilted(xy):
    return 0.1 * xy[:, 0] + 3


def feature(geometry, number=1, **tags):
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, road=NO_ROAD, region=REGION, ground=tilted):
    return barrier_mesh(features, region=region, ground_height=ground, carriageway=road)


def volume(mesh):
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def blocked_share(mesh, y_from, y_to, x_range, z_range):
    """Return the share of level beams along y that meet the mesh (seen in the x-z plane)."""
    corners = mesh.triangles()
    a, b, c = np.moveaxis(corners[..., [0, 2]], 1, 0)
    between = (corners[..., 1].max(axis=1) > y_from) & (corners[..., 1].min(axis=1) < y_to)
    beams = np.random.default_rng(3).uniform(*zip(x_range, z_range, strict=True), (500, 2))
    blocked = 0
    for x, z in beams:
        sides = [
            (q[:, 0] - p[:, 0]) * (z - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])
            for p, q in ((a, b), (b, c), (c, a))
        ]
        inside = np.all(np.array(sides) > 0, axis=0) | np.all(np.array(sides) < 0, axis=0)
        blocked += bool((inside & between).any())
    return blocked / len(beams)


def test_a_wall_has_its_mapped_height_over_sloping_ground():
    mesh, notes = build(
        feature(LineString([(0, 10), (20, 10)]), barrier="wall", height="2 m", width="0.4")
    )
    assert notes == {"wall": 1}
    assert volume(mesh) == pytest.approx(20 * 0.4 * (2 + 0.3))
    above = mesh.vertices[:, 2] - tilted(mesh.vertices)
    assert above.max() == pytest.approx(2)
    assert above.min() == pytest.approx(-0.3)
    assert set(mesh.semantic) == {semantic_id("fence")}


@pytest.mark.parametrize(
    ("kind", "height"),
    [("fence", 1.5), ("guard_rail", 0.75), ("handrail", 1.0), ("jersey_barrier", 0.85)],
)
def test_barriers_have_their_usual_height_and_touch_the_ground(kind, height):
    mesh, _ = build(feature(LineString([(0, 10), (9, 10), (9, 20)]), barrier=kind))
    above = mesh.vertices[:, 2] - tilted(mesh.vertices)
    assert above.max() == pytest.approx(height, abs=0.02)
    assert above.min() < -0.05
    assert volume(mesh) > 0


def test_beams_pass_a_fence_and_not_a_wall():
    line = LineString([(0, 10), (20, 10)])
    flat = {"ground": lambda xy: np.zeros(len(xy))}
    fence, _ = build(feature(line, barrier="fence", height="1.5"), **flat)
    wall, _ = build(feature(line, barrier="wall", height="1.5"), **flat)
    board, _ = build(feature(line, barrier="fence", fence_type="wood", height="1.5"), **flat)
    seen = {"y_from": 0, "y_to": 20, "x_range": (0.1, 19.9), "z_range": (0.05, 1.4)}
    assert 0.05 < blocked_share(fence, **seen) < 0.4
    assert blocked_share(wall, **seen) == 1.0
    assert blocked_share(board, **seen) == 1.0
    assert set(board.material) == {material_id("wood")}


def test_a_ring_is_closed_without_a_seam():
    ring = LineString([(0, 0), (10, 0), (10, 10), (0, 10), (0, 0)])
    mesh, _ = build(feature(ring, barrier="wall", height="2", width="0.2"))
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert set(np.unique(ends, axis=0, return_counts=True)[1]) == {2}
    assert volume(mesh) == pytest.approx(40 * 0.2 * 2.3, rel=0.01)


def test_barriers_open_for_carriageways_and_gates_and_end_at_the_border():
    line = LineString([(-150, 20), (50, 20)])
    gate = feature(Point(30, 20), 2, barrier="gate")
    mesh, _ = build(feature(line, barrier="wall"), gate, road=box(-10, -50, 0, 50))
    x = mesh.vertices[:, 0]
    assert x.min() == pytest.approx(-100)
    assert not ((x > -10.2) & (x < 0.2)).any()
    wall = mesh.select(mesh.material == material_id("brick")).vertices[:, 0]
    assert not ((wall > 28.6) & (wall < 31.4)).any()
    leaf = mesh.select(mesh.material == material_id("metal-painted"))
    assert leaf.vertices[:, 0].min() > 28.4
    assert leaf.vertices[:, 0].max() < 31.6
    assert len(set(mesh.part)) == 4


def test_a_hedge_is_an_uneven_body_of_leaves():
    mesh, _ = build(feature(LineString([(0, 10), (20, 10)]), 4, barrier="hedge", height="1.6"))
    assert set(mesh.semantic) == {semantic_id("vegetation")}
    assert volume(mesh) == pytest.approx(20 * 0.8 * 1.8, rel=0.15)
    above = mesh.vertices[:, 2] - tilted(mesh.vertices)
    assert 1.4 < above.max() <= 1.6 + 0.01
    assert len(np.unique(above.round(3))) > 20


def test_bollards_and_blocks_stand_apart():
    mesh, notes = build(
        feature(LineString([(0, 10), (6, 10)]), barrier="bollard"),
        feature(Point(20, 10), 2, barrier="block"),
    )
    assert notes == {"blocks": 1, "bollard": 1}
    assert len(set(mesh.part)) == 5


def test_flush_kerbs_unknown_barriers_and_underground_walls_are_not_drawn():
    line = LineString([(0, 10), (6, 10)])
    mesh, notes = build(
        feature(line, barrier="kerb", kerb="flush"),
        feature(line, 2, barrier="yes"),
        feature(line, 3, barrier="wall", layer="-1"),
    )
    assert len(mesh.faces) == 0
    assert notes == {}


FENCES = {
    # what of level beams at right angles is stopped: by formula from the wires' and bars' sizes
    "chain_link": (0.08, 0.25),
    "railing": (0.12, 0.35),
    "barbed_wire": (0.02, 0.15),
    "picket": (0.45, 0.65),
    "wood": (1.0, 1.0),
}


def cast_level(mesh, x_range, z_range, count=4000):
    """Return the share of beams along +y that Embree stops at a mesh."""
    rng = np.random.default_rng(5)
    x, z = rng.uniform(*x_range, count), rng.uniform(*z_range, count)
    # From so far that all beams are level and square to the fence.
    origin = np.array([np.mean(x_range), -400.0, np.mean(z_range)])
    way = np.column_stack([x, np.full(count, 10.0), z]) - origin
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    stopped = cast_static(mesh, origin, way).face >= 0
    return float(stopped.mean())


@pytest.mark.parametrize("kind", FENCES)
def test_fences_let_as_many_beams_through_as_their_kind_does(kind):
    mesh, _ = build(
        feature(LineString([(0, 10), (30, 10)]), barrier="fence", fence_type=kind, height="1.8"),
        ground=lambda xy: np.zeros(len(xy)),
    )
    least, most = FENCES[kind]
    assert least <= cast_level(mesh, (0.5, 29.5), (0.2, 1.7)) <= most


def test_a_guard_rail_turns_its_beam_to_the_traffic_and_is_a_w():
    line = LineString([(-20, 7), (20, 7)])
    for road, side in ((box(-50, -5, 50, 5), -1), (box(-50, 9, 50, 19), 1)):
        mesh, _ = build(
            feature(line, barrier="guard_rail"), road=road, ground=lambda xy: np.zeros(len(xy))
        )
        beam = mesh.vertices[np.abs(mesh.vertices[:, 1] - 7) > 0.1]
        assert len(beam) > 0
        assert (np.sign(beam[:, 1] - 7) == side).all()
        # Two waves, each with an upper and a lower corner, within 0.31 m below 0.75 m.
        heights = np.unique(np.round(beam[:, 2], 3))
        assert len(heights) == 4
        assert 0.44 < heights.min() < heights.max() < 0.75


def test_a_kerb_stone_stands_out_of_the_ground_but_not_where_lanes_have_their_own():
    kerb = feature(LineString([(-50, 20), (50, 20)]), barrier="kerb", kerb="raised")
    mesh, _ = build(kerb, ground=lambda xy: np.zeros(len(xy)))
    assert volume(mesh) == pytest.approx(100 * 0.15 * (0.3 + 0.12))
    mesh, notes = build(kerb, road=box(-100, 10, 100, 19))
    assert len(mesh.faces) == 0
    assert notes == {}


def test_a_lift_gate_stands_beside_its_road_with_the_boom_up():
    road = LineString([(0, -50), (0, 50)])
    mesh, notes = build(
        feature(road, 1, highway="service"),
        feature(Point(0, 0), 2, barrier="lift_gate"),
        feature(Point(0, 20), 3, barrier="gate"),
        road=box(-3, -50, 3, 50),
        ground=lambda xy: np.zeros(len(xy)),
    )
    assert notes == {"gates on carriageways, left open": 2}
    road = box(-1.5, -50, 1.5, 50)
    mesh, notes = build(
        feature(LineString([(0, -50), (0, 50)]), 1, highway="service"),
        feature(Point(0, 0), 2, barrier="lift_gate"),
        road=road,
        ground=lambda xy: np.zeros(len(xy)),
    )
    assert notes == {"lift gates": 1}
    assert np.abs(mesh.vertices[:, 0]).min() > 1.5
    assert mesh.vertices[:, 2].max() > 4


def test_nothing_is_built_where_imported_geometry_has_it():
    wall = feature(LineString([(-50, 20), (50, 20)]), barrier="wall", width="0.4", height="2")
    mesh, _ = barrier_mesh(
        [wall],
        region=REGION,
        ground_height=tilted,
        carriageway=NO_ROAD,
        without=box(-10, 0, 10, 40),
    )
    assert volume(mesh) == pytest.approx(80 * 0.4 * 2.3)


@settings(max_examples=60, deadline=None)
@given(
    corners=st.lists(
        st.tuples(st.integers(-60, 60), st.integers(-60, 60)), min_size=2, max_size=8
    ).filter(lambda points: len(set(points)) > 1),
    tags=st.sampled_from(
        [
            {"barrier": "wall"},
            {"barrier": "city_wall"},
            {"barrier": "guard_rail"},
            {"barrier": "hedge"},
            {"barrier": "jersey_barrier"},
            {"barrier": "chain"},
            {"barrier": "kerb"},
            {"barrier": "fence", "fence_type": "chain_link"},
            {"barrier": "fence", "fence_type": "railing"},
            {"barrier": "fence", "fence_type": "wire"},
        ]
    ),
    scale=st.sampled_from([0.05, 0.3, 1.0]),
)
def test_any_line_gives_closed_solids_without_degenerate_faces(corners, tags, scale):
    line = LineString(np.array(corners) * scale)
    mesh, _ = build(feature(line, 7, **tags))
    if not len(mesh.faces):
        return
    assert np.isfinite(mesh.vertices).all()
    assert mesh.areas().min() > 1e-9
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
    assert volume(mesh) > 0
    assert (mesh.vertices[:, 2] - tilted(mesh.vertices)).min() > -2.0
