"""Actors of several bodies: towed by closed forms, linked, never in anybody; dogs on a lead."""

import numpy as np
import pytest
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.actor_table import Place, actor_table
from urbantwin.traffic.assets import Fleet, asset, asset_mesh, bending_names
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.coupling import are_coupled, towed_by
from urbantwin.traffic.paths.obstacles import Blocks, Obstacles
from urbantwin.traffic.paths.overlap import overlaps_of
from urbantwin.traffic.paths.placement import stand
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.simulation import Simulated

STEP_S, SPEED_MS, RADIUS_M = 0.1, 6.0, 30.0


def bending() -> list[str]:
    return [name for name in bending_names() if asset(name).rigid]


class Plane:
    """Flat ground of one level."""

    def levels(self, lanes):
        return np.zeros(len(lanes), int)

    def ceiling(self, xy, lane, lanes):
        return np.full(len(xy), 5.0)

    def height(self, xy, ceiling):
        return np.zeros(len(xy))

    def top(self, xy):
        return np.zeros(len(xy))


def nobody() -> PlanBoxes:
    return PlanBoxes(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))


def standing(boxes: PlanBoxes) -> Blocks:
    return Blocks(boxes, np.zeros(len(boxes.yaw)))


def seen(*ways) -> Simulated:
    """What SUMO would see of fronts (N, 2) with their headings, rad, each on a lane of its own."""
    count = [len(front) for front, _ in ways]
    yaw = np.concatenate([yaw for _, yaw in ways])
    none = np.zeros((0, 9))
    return Simulated(
        step=np.concatenate([np.arange(n) for n in count]).astype(np.int32),
        trip=np.repeat(np.arange(len(ways)), count).astype(np.int32),
        front=np.concatenate([front for front, _ in ways]),
        angle_deg=90.0 - np.degrees(yaw),
        speed=np.full(sum(count), SPEED_MS),
        lane=np.repeat(np.arange(len(ways)), count).astype(np.int32),
        lanes=tuple(f"lane{k}" for k in range(len(ways))),
        signals=(),
        teleports=0,
        collisions=0,
        departed=frozenset(range(len(ways))),
        sumo="",
        observed=Observed(none, none, none, none, none, 0.0, 0, ()),
    )


def circle(radius_m: float, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """A front that goes straight on to a circle to the left, then round it."""
    way = np.arange(0.0, seconds, STEP_S) * SPEED_MS - 30.0
    angle = np.maximum(way, 0.0) / radius_m
    front = np.column_stack(
        [np.minimum(way, 0.0) + radius_m * np.sin(angle), radius_m * (1 - np.cos(angle))]
    )
    return front, angle


def table_of(names, *ways, blocks=None):
    trips = tuple(Trip(asset(name).actor_class, name, 0.0, ("a",)) for name in names)
    place = Place(
        RoadNetwork("right", (), (), (), (), ()),
        Plane(),
        standing(blocks or nobody()),
        Obstacles(LabelledMesh.empty()),
        ACTOR_SCHEMA.empty_table(),
        shapely.box(-999, -999, 999, 999),
    )
    steps = max(len(front) for front, _ in ways)
    made = actor_table(
        seen(*ways), Demand(trips, ()), place, steps=steps, step_s=STEP_S, asset=asset
    )
    return made.actors.table(), made.outside, made.rigid


@pytest.mark.parametrize("name", ["truck-semitrailer", "bus-articulated", "car-with-caravan"])
def test_towed_axles_settle_on_the_circles_of_pythagoras(name, records):
    table, outside, rigid = table_of([name], circle(RADIUS_M, 40.0))
    assert not outside
    assert not rigid
    rows = records(table)
    first, second = asset(name).bodies
    pulls, towed = rows[rows.track == 1], rows[rows.track == 2]
    assert {*pulls.asset} == {first.asset}
    assert {*towed.asset} == {second.asset}
    assert len(pulls) == len(towed)

    def place(row, body, behind_nose_m):
        ahead = body.middle_m - behind_nose_m
        return np.array([row.x + ahead * np.cos(row.yaw), row.y + ahead * np.sin(row.yaw)])

    # The joint is one place, all the time.
    joint = second.guides_m[0]
    for a, b in zip(pulls, towed, strict=True):
        assert np.allclose(place(a, first, joint), place(b, second, joint), atol=1e-6)
    centre = np.array([0.0, RADIUS_M])
    late = len(pulls) - 30
    reach = np.linalg.norm(place(pulls[late], first, joint) - centre)
    axle = np.linalg.norm(place(towed[late], second, second.guides_m[1]) - centre)
    bar = second.guides_m[1] - joint
    assert axle == pytest.approx(np.sqrt(reach**2 - bar**2), abs=0.05)
    # On the straight they stood in line, as long as the catalogue says.
    assert np.ptp([pulls[0].yaw, towed[0].yaw]) == pytest.approx(0.0, abs=1e-6)
    nose = pulls[0].x + pulls[0].length / 2
    tail = towed[0].x - towed[0].length / 2
    assert nose - tail == pytest.approx(asset(name).length, abs=1e-6)


def test_bodies_are_told_to_hang_together_and_do_not_overlap(records):
    straight = np.arange(0.0, 20.0, STEP_S) * SPEED_MS
    beside = np.column_stack([straight - 60.0, np.full(len(straight), -30.0)])
    table, *_ = table_of(
        ["truck-semitrailer_white", "truck-semitrailer_black"],
        circle(RADIUS_M, 20.0),
        (beside, np.zeros(len(straight))),
    )
    assert towed_by(table) == {3: 1, 4: 2}
    rows = records(table)
    columns = {name: rows[name] for name in ("asset", "x", "y", "yaw")}
    at = {int(row.track): k for k, row in enumerate(rows) if row.time_s == 5.0}
    pairs = np.array([[at[1], at[3]], [at[3], at[1]], [at[1], at[4]], [at[1], at[2]]])
    assert are_coupled(columns, pairs).tolist() == [True, True, False, False]
    # In plan a semi-trailer lies over its tractor.
    boxes = [
        shapely.affinity.rotate(
            shapely.box(r.x - r.length / 2, r.y - 1.0, r.x + r.length / 2, r.y + 1.0), r.yaw,
            use_radians=True,
        )
        for r in (rows[at[1]], rows[at[3]])
    ]  # fmt: skip
    assert boxes[0].intersection(boxes[1]).area > 3.0
    found = overlaps_of(table, table.slice(0, 0), STEP_S, asset_mesh("car-kei").select(slice(0, 0)))
    assert found["actors"] == 0


@pytest.mark.parametrize(("beside_m", "cuts"), [(3.2, True), (12.0, False)])
def test_who_would_cut_a_corner_into_somebody_does_not_bend(beside_m, cuts, records):
    """A car waits inside of the bend: where the trailer comes by, or well beside it."""
    radius, angle = 15.0, np.pi / 4
    inside = np.array([np.sin(angle), -np.cos(angle)]) * (radius - beside_m) + [0.0, radius]
    waits = PlanBoxes(np.zeros(1, int), inside[None], np.array([angle]), np.array([[2.2, 0.9]]))
    names = ["truck-semitrailer_grey"]
    table, _, rigid = table_of(names, circle(radius, 12.0), blocks=waits)
    rows = records(table)
    assert rigid == (frozenset({0}) if cuts else frozenset())
    bodies = ["truck-rigid-26t_grey"] if cuts else ["trailer-curtain", "truck-tractor_grey"]
    assert sorted({*rows.asset}) == bodies
    # The front is where it was.
    front, _ = circle(radius, 12.0)
    row = rows[(rows.track == 1) & (rows.time_s == 2.0)][0]
    assert row.x + row.length / 2 == pytest.approx(front[20, 0], abs=0.3)


def test_who_is_prescribed_does_not_bend():
    for kind in ("truck", "bus"):
        drawn = [asset(Fleet("DE", 1).body(kind, n)) for n in range(200)]
        assert any(one.bodies for one in drawn)
        assert not any(asset(Fleet("DE", 1).body(kind, n, bends=False)).bodies for n in range(200))
    for name in bending():
        assert all(asset(body.asset).length < asset(name).length for body in asset(name).bodies)


def test_a_dog_walks_beside_whom_it_belongs_to(records):
    name = "pedestrian-man-with-dog"
    table, *_ = table_of([name], circle(RADIUS_M, 20.0))
    rows = records(table)
    walks, led = rows[rows.track == 1], rows[rows.track == 2]
    assert {*walks["class"]} == {"pedestrian"}
    assert {*led["class"]} == {"animal"}
    assert {*led.asset} == {"animal-dog"}
    away = np.hypot(walks.x - led.x, walks.y - led.y)
    assert away.min() > (asset("pedestrian-man").width + asset("animal-dog").width) / 2
    assert away.max() < 0.8
    # It looks where they go, and takes its own steps.
    assert np.abs(np.angle(np.exp(1j * (walks.yaw - led.yaw)))).max() < 0.2
    assert len({*led.phase}) > 6
    assert len({*zip(walks.phase.tolist(), led.phase.tolist(), strict=True)}) > 20
    found = overlaps_of(table, table.slice(0, 0), STEP_S, asset_mesh("car-kei").select(slice(0, 0)))
    assert found["actors"] == 0
    assert towed_by(table) == {}


def test_what_is_towed_leans_on_what_pulls_it():
    """On a slope every body lies in it, with one axle of its own too; wheels touch the ground."""

    class Slope(Plane):
        def height(self, xy, ceiling):
            return xy @ np.array([0.05, 0.02])

    for name in bending():
        towed = asset(asset(name).bodies[1].asset)
        assert towed.hitch > towed.length / 2 - 1.7
        z, pitch, roll = stand(
            Slope(), towed.supports, np.array([[3.0, 4.0]]), np.zeros(1), np.full(1, 9.0)
        )
        assert pitch[0] == pytest.approx(-np.arctan(0.05), abs=1e-4)
        assert roll[0] == pytest.approx(np.arctan(0.02), abs=1e-3)
        assert z[0] == pytest.approx(0.05 * 3.0 + 0.02 * 4.0, abs=1e-3)
