"""Parked vehicles: where spaces are, who stands in them, and who does not."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.motion import ACTOR_SCHEMA, Motion
from urbantwin.traffic.parked import FIRST_PARKED_TRACK, park
from urbantwin.traffic.parked.spaces import car_park_spaces, rectangle, street_spaces
from urbantwin.traffic.paths.placement import Ground
from urbantwin.traffic.signals import SIGNAL_SCHEMA

ALL = {"street": 1.0, "car_park": 1.0}


def lane(name: str, kind: str, y: float, width: float, *, back: bool = False) -> Lane:
    x = np.linspace(0.0, 120.0, 25)
    centre = np.column_stack([x[::-1] if back else x, np.full(25, y), np.zeros(25)])
    return Lane(name, "r", kind, width, 13.9, centre, np.zeros((0, 2)), 0, ("car",), (), "")


def street(width: float, *, crossing: bool = False) -> RoadNetwork:
    """A street of two lanes with parking south of it, where traffic runs eastwards."""
    lanes = [
        lane("east", "driving", -1.75, 3.5),
        lane("west", "driving", 1.75, 3.5, back=True),
        lane("p", "parking", -3.5 - width / 2, width),
    ]
    if crossing:
        across = np.array([[60.0, -12.0, 0.0], [60.0, 4.0, 0.0]])
        flat = np.zeros((0, 2))
        lanes.append(Lane("c", "", "crossing", 4.0, 1.4, across, flat, 0, ("pedestrian",), (), "j"))
    return RoadNetwork("right", (), tuple(lanes), (), (), ())


def slab(x0: float, y0: float, x1: float, y1: float, name: str, z: float = 0.0) -> LabelledMesh:
    corners = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return LabelledMesh.build(corners, faces, semantic_id(name), material_id("asphalt"))


def parked(network: RoadNetwork, mesh: LabelledMesh, share=ALL, seed: int = 1):
    ground = Ground(slab(-50, -80, 200, 80, "road"), network)
    return park(network, mesh, ground, share, fleet=Fleet("DE", seed), asset=asset)


ROAD = slab(-50, -80, 200, 80, "road")


def outlines(rows):
    return [rectangle(np.array([r["x"], r["y"]]), r["yaw"], r["length"], r["width"]) for r in rows]


def test_along_the_road_they_look_where_traffic_runs_and_stand_at_the_kerb() -> None:
    spaces = list(street_spaces(street(2.0)))
    assert len(spaces) == 20  # of 6 m, on 120 m
    found = parked(street(2.0), slab(0, 20, 1, 21, "terrain"))
    assert len(found.rows) >= 12  # those that are no longer than 5.5 m, nor too wide
    for row, outline in zip(found.rows, outlines(found.rows), strict=True):
        assert abs(row["yaw"]) < 0.05
        low, high = outline.bounds[1], outline.bounds[3]
        assert -5.5 < low < -5.0  # the kerb is at -5.5
        assert high < -3.5 + 0.4  # the lane of traffic begins at -3.5
        assert row["track"] >= FIRST_PARKED_TRACK
        assert row["speed"] == 0.0
    for k, one in enumerate(outlines(found.rows)):
        for other in outlines(found.rows)[:k]:
            assert one.distance(other) >= 0.3


def test_across_the_road_they_stand_square_to_it_with_room_for_doors() -> None:
    found = parked(street(5.0), slab(0, 20, 1, 21, "terrain"))
    assert len(found.rows) > 30
    yaw = np.array([row["yaw"] for row in found.rows])
    assert np.abs(np.abs(yaw) - np.pi / 2).max() < 0.05
    # Most look away from the traffic; some came in backwards.
    assert 0.1 < np.mean(yaw > 0) < 0.5
    gaps = [
        a.distance(b) for a, b in zip(outlines(found.rows), outlines(found.rows)[1:], strict=False)
    ]
    assert min(gaps) > 0.3


def test_diagonally_they_stand_at_45_degrees_within_their_lane() -> None:
    """RASt 06, 4.85 m deep: bays of 2.5 m at 45 degrees take 2.5 / sin 45 = 3.54 m of kerb."""
    usual = street(4.85)
    lanes = [replace(one, parking="diagonal" * (one.id == "p")) for one in usual.lanes]
    network = replace(usual, lanes=tuple(lanes))
    spaces = list(street_spaces(network))
    middles = np.array([space.place[0] for space in spaces])
    assert np.diff(np.sort(middles)) == pytest.approx(3.54, abs=0.01)
    assert len(spaces) == (120 - 4.85) // 3.54
    found = parked(network, slab(0, 20, 1, 21, "terrain"))
    assert len(found.rows) > 20
    # Traffic runs eastwards beside them, the kerb is to the right: they came in forwards.
    assert np.array([row["yaw"] for row in found.rows]) == pytest.approx(-np.pi / 4, abs=0.05)
    shapes = outlines(found.rows)
    for outline in shapes:
        assert outline.bounds[1] > -3.5 - 4.85 - 0.35
        assert outline.bounds[3] < -3.5 + 0.35
    assert min(a.distance(b) for a, b in itertools.pairwise(shapes)) > 0.3


def test_nobody_parks_on_a_crossing_before_a_driveway_or_in_a_wall() -> None:
    wall = slab(20, -5.4, 21, -3.6, "building", z=1.0)
    driveway = slab(84, -30, 90, -5.6, "road")
    found = parked(street(2.0, crossing=True), LabelledMesh.concatenate([wall, driveway]))
    areas = [
        shapely.box(57, -12, 63, 4),
        shapely.box(20, -5.4, 21, -3.6),
        shapely.box(85, -5.5, 89, -3.5),
    ]
    assert len(found.rows) > 6
    for one in outlines(found.rows):
        assert not any(one.intersects(area) for area in areas)
    notes = found.notes["street"]
    assert notes["driveway"] >= 1
    assert notes["spaces"] == 20
    assert notes["taken"] == len(found.rows)


def test_the_share_that_is_asked_for_is_taken() -> None:
    long = RoadNetwork("right", (), street(5.0).lanes, (), (), ())
    counts = [
        len(parked(long, slab(0, 20, 1, 21, "terrain"), {"street": 0.5}, seed).rows)
        for seed in range(8)
    ]
    full = len(parked(long, slab(0, 20, 1, 21, "terrain"), {"street": 1.0}).rows)
    assert np.mean(counts) == pytest.approx(0.5 * full, rel=0.15)
    assert parked(long, slab(0, 20, 1, 21, "terrain"), {}).rows == []


def test_a_space_decides_for_itself() -> None:
    mesh = slab(0, 20, 1, 21, "terrain")
    full, half = (parked(street(2.0), mesh, {"street": share}).rows for share in (1.0, 0.5))
    by_place = {(row["x"], row["y"]): row["asset"] for row in full}
    assert 0 < len(half) < len(full)
    # Who stands there at half the occupancy stands there, the same, at the full one.
    assert all(by_place[row["x"], row["y"]] == row["asset"] for row in half)


def test_a_car_park_has_rows_with_aisles_between() -> None:
    mesh = LabelledMesh.concatenate([slab(0, 30, 60, 62, "parking"), ROAD])
    spaces = list(car_park_spaces(mesh, street(2.0)))
    # 32 m deep: rows at 0 to 5, 11 to 16, 16 to 21, 27 to 32 m; 24 spaces of 2.5 m each, less
    # what the rounding of the corners takes.
    depths = sorted({round(float(space.place[1]) - 30, 1) for space in spaces})
    assert depths == pytest.approx([2.5, 13.5, 18.5, 29.5], abs=0.2)
    assert 4 * 22 <= len(spaces) <= 4 * 24
    area = shapely.box(0, 30, 60, 62).buffer(0.1)
    assert all(area.contains(space.outline()) for space in spaces)


def test_a_motion_keeps_who_is_parked_and_shows_them_at_every_step(
    tmp_path: Path,
) -> None:
    rows = parked(street(2.0), slab(0, 20, 1, 21, "terrain"))
    manifest = {
        "kind": "motion", "version": 1, "twin_sha256": "", "seed": 1, "step_s": 0.1, "steps": 3,
        "duration_s": 0.3, "left_out": [], "teleports": 0, "collisions": 0,
    }  # fmt: skip

    empty = ACTOR_SCHEMA.empty_table()
    motion = Motion(manifest, empty, SIGNAL_SCHEMA.empty_table(), parked=rows.table(ACTOR_SCHEMA))
    motion.with_meshes().save(tmp_path / "motion")
    again = Motion.load(tmp_path / "motion")
    first, last = again.at(0.0), again.at(0.2)
    assert len(first) == len(rows.rows)
    np.testing.assert_array_equal(first["x"], last["x"])
    assert (last["time_s"] == 0.2).all()
    for row in first[:5]:
        size = np.ptp(again.mesh(row["asset"], row["phase"]).vertices, axis=0)
        np.testing.assert_allclose(size, [row["length"], row["width"], row["height"]], atol=1e-5)
