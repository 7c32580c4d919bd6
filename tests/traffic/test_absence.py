"""Who is left out lest it passes through somebody, against polygons of every pair."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.motion_rows import as_rows
from urbantwin.traffic.paths.absence import NOBODY, Absent, Bystanders, absent_from
from urbantwin.traffic.paths.obstacles import Obstacles
from urbantwin.traffic.paths.overlap import overlaps_of, overlaps_told

STEP_S = 0.1
REGION = shapely.Point(0, 0).buffer(50.0)
SIZES = {"pedestrian": (0.6, 0.5), "animal": (0.9, 0.3), "car": (4.5, 1.8), "bus": (12.0, 2.5)}
NOTHING = Obstacles(LabelledMesh.empty())

Row = tuple[int, int, str, float, float, float]


def table(rows: list[Row]) -> pa.Table:
    """Actors by step, track, class, x, y, yaw."""
    plain = {"asset": "a", "phase": 0, "z": 0.0, "pitch": 0.0, "roll": 0.0, "speed": 1.0}
    whole = []
    for step, track, kind, x, y, yaw in sorted(rows):
        length, width = SIZES[kind]
        one = {"time_s": round(step * STEP_S, 9), "track": track, "class": kind, "lane": ""}
        sized = {"x": x, "y": y, "yaw": yaw, "length": length, "width": width, "height": 1.7}
        whole.append(one | sized | plain)
    return pa.Table.from_pylist(whole, schema=ACTOR_SCHEMA)


def absent(
    rows: list[Row],
    *,
    leads: dict[int, int] | None = None,
    obstacles: Obstacles = NOTHING,
    parked: pa.Table | None = None,
    beside: Bystanders = NOBODY,
) -> tuple[pa.Table, Absent]:
    """Who is there, and who is not."""
    actors = table(rows)
    tracks = actors["track"].to_numpy().astype(np.int64)
    led = np.array([(leads or {}).get(track, track) for track in tracks.tolist()], np.int64)
    standing = ACTOR_SCHEMA.empty_table() if parked is None else parked
    # Of whole steps.
    half = int(np.searchsorted(actors["time_s"].to_numpy(), 20 * STEP_S - 1e-6))
    found = absent_from(
        [actors.slice(0, half), actors.slice(half)],
        tracks,
        led,
        standing,
        obstacles,
        REGION,
        step_s=STEP_S,
        beside=beside,
    )
    return actors.filter(pa.array(~found.rows)), found


def overlapping(actors: pa.Table) -> set[tuple[int, int]]:
    """Pairs of tracks that share more than 0.05 m2 at a step."""
    found: set[tuple[int, int]] = set()
    for time_s in np.unique(actors["time_s"].to_numpy()):
        now = actors.filter(pc.equal(actors["time_s"], time_s))
        x, y, yaw, length, width = (
            now[name].to_numpy() for name in ("x", "y", "yaw", "length", "width")
        )
        turned = np.exp(1j * yaw)[:, None]
        sides = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j])
        corners = sides.real * length[:, None] / 2 + 1j * sides.imag * width[:, None] / 2
        placed = (x + 1j * y)[:, None] + corners * turned
        boxes = shapely.polygons(np.stack([placed.real, placed.imag], axis=-1))
        one, other = np.triu_indices(len(boxes), 1)
        met = shapely.area(shapely.intersection(boxes[one], boxes[other])) > 0.05
        track = now["track"].to_numpy()
        pairs = np.sort(np.column_stack([track[one[met]], track[other[met]]]), axis=1)
        found |= {(a, b) for a, b in pairs.tolist()}
    return found


def passing(
    track: int, kind: str, from_xy: tuple[float, float], to: tuple[float, float]
) -> list[Row]:
    """Somebody on a straight way, in forty steps."""
    x, y = np.linspace(from_xy, to, 40).T
    yaw = float(np.arctan2(to[1] - from_xy[1], to[0] - from_xy[0]))
    return [(n, track, kind, float(x[n]), float(y[n]), yaw) for n in range(40)]


def test_nobody_overlaps_any_more_and_nobody_is_left_out_for_nothing() -> None:
    random = np.random.default_rng(7)
    rows = []
    for track in range(1, 31):
        kind = ("pedestrian", "pedestrian", "car", "bus")[track % 4]
        ends = random.uniform(-40, 40, (2, 2))
        rows += passing(track, kind, tuple(ends[0]), tuple(ends[1]))
    before = overlapping(table(rows))
    assert len(before) > 10
    there, found = absent(rows)
    assert overlapping(there) == set()
    kept = set(there["track"].to_pylist())
    gone = set(range(1, 31)) - kept
    assert 0 < len(gone) == found.told["visits"]
    assert all(gone & set(pair) for pair in before)
    assert all(any(one in pair and kept & set(pair) for pair in before) for one in gone)


def test_the_car_that_drives_through_five_people_goes_and_the_one_before_a_bus() -> None:
    people = [
        row for n in range(5) for row in passing(n + 2, "pedestrian", (3.0 * n, 0), (3.0 * n, 0))
    ]
    there, found = absent([*people, *passing(1, "car", (-40, 0), (40, 0))])
    assert set(there["track"].to_pylist()) == {2, 3, 4, 5, 6}
    assert found.told["actors"] == {"car": 1}
    (one,) = found.told["each"]
    assert (one["with"], one["from_s"], one["until_s"]) == ("pedestrian", 0.0, 3.9)
    assert found.told["with"] == {"car and pedestrian": 1}
    assert found.told["most_at"] == {"x": one["x"], "y": one["y"], "visits": 1}
    there, _ = absent([*people[:40], *passing(1, "bus", (-40, 0), (40, 0))])
    assert set(there["track"].to_pylist()) == {1}


def test_it_is_away_from_one_border_of_the_region_to_the_other_and_there_again() -> None:
    """Through the region, out, and back: who stands in its way comes when it is back."""
    out = passing(1, "car", (-100, 0), (100, 0))
    back = [
        (40 + n, 1, "car", -row[3], 5.0, np.pi)
        for n, row in enumerate(passing(1, "car", (-100, 0), (100, 0)))
    ]
    bus = [(n, 2, "bus", 0.0, 5.0, 0.0) for n in range(80)]
    there, found = absent([*out, *back, *bus])
    away = np.setdiff1d(
        np.arange(80),
        np.round(there.filter(pc.equal(there["track"], 1))["time_s"].to_numpy() / STEP_S),
    )
    x = np.array([row[3] for row in [*out, *back]])
    assert (away >= 40).all()
    assert (np.abs(x[away]) <= 70.0).all()
    inside = 40 + np.flatnonzero(np.abs(x[40:]) <= 49.0)
    assert np.isin(inside, away).all()
    assert (found.told["visits"], found.told["of"]) == (1, 6)
    assert overlapping(there) == set()


def test_a_dog_goes_with_whom_leads_it_and_not_the_other_way_round() -> None:
    walk = passing(1, "pedestrian", (-20, 0), (20, 0))
    dog = passing(2, "animal", (-20, 0.6), (20, 0.6))
    car = [(n, 3, "car", 0.0, -1.0, 0.0) for n in range(40)]
    assert set(absent([*walk, *dog, *car], leads={2: 1})[0]["track"].to_pylist()) == {3}
    car = [(n, 3, "car", 0.0, 1.4, 0.0) for n in range(40)]
    assert set(absent([*walk, *dog, *car], leads={2: 1})[0]["track"].to_pylist()) == {1, 3}


def test_who_meets_something_that_stands_goes_at_every_visit() -> None:
    corners = np.array([[0, 0, 0], [0, 0, 3], [0, 0.3, 3.0]])
    pole = LabelledMesh.build(corners, [[0, 1, 2]], semantic_id("pole"), material_id("concrete"))
    there, found = absent(passing(1, "car", (-40, 0), (40, 0)), obstacles=Obstacles(pole))
    assert there.num_rows == 0
    assert found.told["each"][0]["with"] == "pole"
    parked = table([(0, 9, "car", 0.0, 0.0, 0.0)])
    assert absent(passing(1, "car", (-40, 0), (40, 0)), parked=parked)[0].num_rows == 0


@pytest.mark.parametrize("own", [1, 2])
def test_actors_of_an_event_stay_and_before_it_everybody_is_as_without_it(own: int) -> None:
    rows = [*passing(1, "car", (-40, 0), (40, 0)), *passing(2, "pedestrian", (0, 0), (0, 0))]
    there, found = absent(rows)
    assert set(there["track"].to_pylist()) == {1}
    event = Bystanders(frozenset({own}), 0, NOBODY.absent)
    assert set(absent(rows, beside=event)[0]["track"].to_pylist()) == {own}
    # Both are there when the event begins: neither goes.
    late = replace(event, own=frozenset(), until=5)
    assert set(absent(rows, beside=late)[0]["track"].to_pylist()) == {1, 2}
    # One was not there without it, and stays away.
    known = replace(late, absent=found.steps[found.steps[:, 1] < 5])
    assert set(absent(rows, beside=known)[0]["track"].to_pylist()) == {1}


def test_what_overlaps_among_those_who_are_left_is_what_would_be_found_among_them() -> None:
    random = np.random.default_rng(3)
    rows = []
    for track in range(1, 25):
        ends = random.uniform(-30, 30, (2, 2))
        kind = ("pedestrian", "car")[track % 2]
        rows += passing(track, kind, tuple(ends[0]), tuple(ends[1]))
    corners = np.array([[0, 0, 0], [6, 0, 3], [0, 6, 3.0]])
    scene = LabelledMesh.build(corners, [[0, 1, 2]], semantic_id("fence"), material_id("concrete"))
    parked = table([(0, 90, "car", 9.0, 9.0, 0.3), (0, 91, "bus", -9.0, -9.0, 1.3)])
    event = Bystanders(frozenset(range(1, 19)), 0, NOBODY.absent)
    there, found = absent(rows, obstacles=Obstacles(scene), parked=parked, beside=event)
    assert found.rows.any()
    told = overlaps_told(found.left, as_rows(there).parts(), parked)
    assert told == overlaps_of(there, parked, STEP_S, scene)
    assert told["actors"] > 5
    assert told["scene"]
    assert any(91 in row["tracks"] or 90 in row["tracks"] for row in told["worst"])
