"""Overlaps, against every pair's polygons and against rays that cross a box."""

import numpy as np
import pyarrow as pa
import pytest
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import RayScene
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.paths.box_plan import PlanBoxes, meetings, near_pairs, shared_areas
from urbantwin.traffic.paths.overlap import overlaps_of


def crowd(seed: int, count: int = 300) -> PlanBoxes:
    """People, cars and buses, strewn over a few steps."""
    random = np.random.default_rng(seed)
    sizes = np.array([[0.7, 0.6], [4.5, 1.8], [12.0, 2.5]])
    half = sizes[random.choice(3, count, p=[0.6, 0.3, 0.1])] / 2
    place = random.uniform(-20, 20, (count, 2))
    return PlanBoxes(random.integers(0, 6, count), place, random.uniform(-9, 9, count), half)


def outline(boxes: PlanBoxes, row: int) -> shapely.Polygon:
    """The outline of a box, by turning and moving a rectangle."""
    length, width = 2 * boxes.half[row]
    shape = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
    turned = shapely.affinity.rotate(shape, boxes.yaw[row], origin=(0, 0), use_radians=True)
    return shapely.affinity.translate(turned, *boxes.xy[row])


@pytest.mark.parametrize("seed", [1, 2])
def test_every_pair_that_shares_ground_is_found_with_its_area(seed: int) -> None:
    boxes = crowd(seed)
    shapes = [outline(boxes, row) for row in range(len(boxes.yaw))]
    pairs = near_pairs(boxes, 0.0)
    found = {
        tuple(pair): area
        for pair, area in zip(pairs.tolist(), shared_areas(boxes, pairs), strict=True)
    }
    met = 0
    for one in range(len(shapes)):
        for other in range(one + 1, len(shapes)):
            area = 0.0
            if boxes.step[one] == boxes.step[other]:
                area = shapes[one].intersection(shapes[other]).area
            assert found.get((one, other), 0.0) == pytest.approx(area, abs=1e-9)
            met += area > 0
    assert met > 20


def test_the_way_out_parts_two_boxes_and_no_shorter_one_does() -> None:
    boxes = crowd(3)
    pairs = near_pairs(boxes, 0.0)
    deep, out = meetings(boxes, pairs)
    for (one, other), depth, way in zip(pairs.tolist(), deep, out, strict=True):
        a, b = outline(boxes, one), outline(boxes, other)
        assert (depth > 1e-9) == (a.intersection(b).area > 1e-9)
        if depth <= 0:
            continue
        apart = shapely.affinity.translate(a, *(way * (depth + 1e-6)))
        assert apart.intersection(b).area < 1e-6
        for angle in np.linspace(0, 2 * np.pi, 24):
            shorter = 0.98 * depth * np.array([np.cos(angle), np.sin(angle)])
            assert shapely.affinity.translate(a, *shorter).intersection(b).area > 0


def table(rows: list[tuple[float, int, str, float, float, float]]) -> pa.Table:
    """Actors of 2 x 1 x 1.7 m: time, track, class, x, y, yaw."""
    plain = {"asset": "a", "phase": 0, "z": 0.0, "pitch": 0.0, "roll": 0.0, "speed": 1.0}
    sized = {"length": 2.0, "width": 1.0, "height": 1.7, "lane": ""}
    names = ("time_s", "track", "class", "x", "y", "yaw")
    whole = [dict(zip(names, row, strict=True)) | plain | sized for row in rows]
    return pa.Table.from_pylist(whole, schema=ACTOR_SCHEMA)


def block(low: tuple[float, ...], high: tuple[float, ...], kind: str) -> LabelledMesh:
    corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, -1).T
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [face for a, b, c, d in quads for face in ([a, b, c], [a, c, d])]
    return LabelledMesh.build(corners, faces, semantic_id(kind), material_id("concrete"))


def test_a_pair_counts_once_and_where_it_is_worst() -> None:
    rows = [
        (0.0, 1, "car", 0.0, 0.0, 0.0), (0.0, 2, "bus", 1.9, 0.0, 0.0),
        (0.1, 1, "car", 0.0, 0.0, 0.0), (0.1, 2, "bus", 1.0, 0.0, 0.0),
        (0.1, 3, "car", 0.0, 1.04, 0.0), (0.2, 1, "car", 50.0, 0.0, 0.0),
    ]  # fmt: skip
    found = overlaps_of(table(rows), ACTOR_SCHEMA.empty_table(), 0.1, LabelledMesh.empty())
    assert (found["actors"], found["between"], found["scene"]) == (1, {"bus and car": 1}, 0)
    (worst,) = found["worst"]
    assert (worst["tracks"], worst["time_s"], worst["area_m2"]) == ([1, 2], 0.1, 1.0)


def test_what_stands_in_the_way_is_met_between_knee_and_head() -> None:
    scene = LabelledMesh.concatenate(
        [
            block((0.9, -0.05, 0.0), (1.0, 0.05, 5.0), "pole"),
            block((10, -1, 0), (11, 1, 0.3), "other-object"),  # a curb's height
            block((20, -1, 2.5), (21, 1, 3), "traffic-sign"),  # above the head
            block((30, -1, 0), (31, 1, 4), "vegetation"),
        ]
    )
    rows = [(0.0, n, "car", 10.0 * (n - 1), 0.0, 0.0) for n in (1, 2, 3, 4)]
    rows.append((0.0, 5, "car", 0.0, 0.53, 0.0))  # touches the pole by 2 cm
    found = overlaps_of(table(rows), ACTOR_SCHEMA.empty_table(), 0.1, scene)
    assert (found["scene"], found["with"]) == (1, {"car and pole": 1})
    (hit,) = found["hits"]
    assert (hit["track"], hit["with"], hit["time_s"], hit["x"], hit["y"]) == (1, "pole", 0, 0, 0)


def test_boxes_that_rays_cross_meet_the_scene() -> None:
    """Against Embree: rays along a box, densely, hit what stands in it."""
    random = np.random.default_rng(4)
    parts = [
        block((x, y, 0.0), (x + 0.4, y + 0.4, 4.0), "pole")
        for x, y in random.uniform(-15, 15, (60, 2))
    ]
    scene = LabelledMesh.concatenate(parts)
    rays = RayScene(scene.vertices, scene.faces)
    rows = [(0.0, n, "car", *random.uniform(-15, 15, 2), random.uniform(-3, 3)) for n in range(120)]
    expected = 0
    for _, _, _, x, y, yaw in rows:
        ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        left = np.array([-ahead[1], ahead[0], 0.0])
        aside = np.linspace(-0.45, 0.45, 41)[:, None]
        origins = np.array([x, y, 1.0]) - 0.95 * ahead + aside * left
        hits = rays.cast(origins, np.tile(ahead, (41, 1)).astype(np.float32))
        inside = rays.cast(origins, np.tile([0, 0, 1.0], (41, 1)).astype(np.float32))
        expected += bool((hits.range_m < 1.9).any() or np.isfinite(inside.range_m).any())
    found = overlaps_of(table(rows), ACTOR_SCHEMA.empty_table(), 0.1, scene)
    assert found["scene"] == expected > 10


def test_who_drives_into_a_parked_car_is_counted_at_whatever_step() -> None:
    rows = [(round(0.1 * n, 1), 1, "bus", 1.0 * n, 0.0, 0.0) for n in range(20)]
    parked = table([(0.0, 7, "car", 15.0, 0.4, 0.3), (0.0, 8, "car", 15.0, 2.0, 0.0)])
    found = overlaps_of(table(rows), parked, 0.1, LabelledMesh.empty())
    assert found["between"] == {"bus and car": 1}
    assert found["worst"][0]["tracks"] == [1, 7]
