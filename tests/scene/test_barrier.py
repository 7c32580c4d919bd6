import numpy as np
import pytest
from shapely import LineString, Point, Polygon, box

from urbantwin.scene.barrier import barrier_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

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
    assert not ((x > 28.6) & (x < 31.4)).any()
    assert len(set(mesh.part)) == 3


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


def test_kerbs_gates_and_underground_walls_are_not_drawn():
    line = LineString([(0, 10), (6, 10)])
    mesh, notes = build(
        feature(line, barrier="kerb"),
        feature(line, 2, barrier="gate"),
        feature(line, 3, barrier="wall", layer="-1"),
    )
    assert len(mesh.faces) == 0
    assert notes == {}
