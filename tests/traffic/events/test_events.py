"""Events on a signalised crossing: who does what, and who is not touched by it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from urbantwin.errors import StageError
from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic import Motion, run_traffic
from urbantwin.traffic.events.measures import gaps
from urbantwin.traffic.events.surroundings import Surroundings
from urbantwin.traffic.insertion import inserted
from urbantwin.traffic.prescribed import PrescribedPath, TwinSurface, usual_asset
from urbantwin.traffic.run import with_more
from urbantwin.twin import Twin, load_twin

SECONDS = 40.0
EAST = {"x": -40.0, "y": -2.0}  # on the way to the junction from the west
WITHIN = {"within_s": 30.0}


@pytest.fixture(scope="module")
def quiet_twin(
    crossing_net: Path, twin_of: Callable[..., Twin], tmp_path_factory: pytest.TempPathFactory
) -> Twin:
    per_hour = {"car": 500.0, "bicycle": 20.0, "pedestrian": 200.0}
    folder = tmp_path_factory.mktemp("quiet") / "twin"
    return twin_of(folder, crossing_net, per_hour, warmup_s=20.0)


def driven(twin: Twin, folder: Path, *events: dict[str, Any], seconds: float = SECONDS) -> Motion:
    return run_traffic(twin, folder, seconds=seconds, changes={"scenario": list(events)})


@pytest.fixture(scope="module")
def usual(quiet_twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    return run_traffic(quiet_twin, tmp_path_factory.mktemp("usual") / "m", seconds=SECONDS)


@pytest.fixture(scope="module")
def put_in(quiet_twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    return driven(
        quiet_twin,
        tmp_path_factory.mktemp("put") / "m",
        {"event": "near_miss", "at_s": 15.0, "place": EAST, "pet_s": 0.8, **WITHIN},
        {"event": "near_miss", "at_s": 15.0, "place": EAST, "ttc_s": 1.5, **WITHIN},
        {"event": "crowd", "at_s": 5.0, "place": {"x": -30.0, "y": -10.0}, "count": 6},
        {"event": "bicycle_without_light", "at_s": 10.0, "place": EAST},
    )


@pytest.fixture(scope="module")
def busy(real_drive: Callable[[str], tuple[Twin, Motion]]) -> Motion:
    return real_drive("crossing")[1]


@pytest.fixture(scope="module")
def reacted(crossing_twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    return driven(
        crossing_twin,
        tmp_path_factory.mktemp("reacted") / "m",
        {"event": "hard_brake", "at_s": 8.0, "place": EAST, "deceleration": 6.0, **WITHIN},
        {"event": "collision", "at_s": 8.0, "place": {"x": 2.0, "y": -40.0}},
        {"event": "red_light_running", "at_s": 8.0, "place": {"x": 30.0, "y": 2.0}},
        {"event": "work_zone", "at_s": 9.0, "lasts_s": 20.0, "length_m": 8.0}
        | {"place": {"x": 2.0, "y": -90.0}},
    )


def rows(motion: Motion) -> pd.DataFrame:
    return motion.actors.to_pandas()


def test_who_is_put_in_changes_nobody(usual: Motion, put_in: Motion) -> None:
    others = rows(put_in)
    others = others[others.track <= rows(usual).track.max()].reset_index(drop=True)
    pd.testing.assert_frame_equal(others, rows(usual))
    assert put_in.signals.equals(usual.signals)


def test_a_near_miss_is_as_near_as_was_asked_for(put_in: Motion) -> None:
    by_pet, by_ttc = put_in.manifest["events"][:2]
    assert by_pet["nearest"]["pet_s"] == pytest.approx(0.8, abs=0.07)
    assert by_ttc["nearest"]["ttc_s"] == pytest.approx(1.5, abs=0.07)
    # Nobody is hit: not by the measure's own boxes, and not by any other actor.
    for event in (by_pet, by_ttc):
        assert event["nearest"]["gap_m"] > 0.2
        passage = Surroundings(put_in).passage(event["tracks"][0])
        nearest = Surroundings(put_in).nearest(passage, frozenset({event["tracks"][0]}))
        assert nearest is None or nearest.gap_m > 0.2


def test_a_bicycle_without_light_sends_nothing_back(put_in: Motion) -> None:
    track = put_in.manifest["events"][3]["tracks"][0]
    shown = rows(put_in)
    shown = shown[shown.track == track]
    names = set(zip(shown.asset, shown.phase, strict=True))
    assert len(names) > 1
    for key in names:
        assert not (put_in.mesh(*key).material == material_id("retroreflector")).any()


def test_nothing_differs_before_the_first_event(busy: Motion, reacted: Motion) -> None:
    before, with_them = (rows(one)[rows(one).time_s < 8.0] for one in (busy, reacted))
    pd.testing.assert_frame_equal(with_them.reset_index(drop=True), before.reset_index(drop=True))
    assert not rows(busy).equals(rows(reacted))
    assert max(event["seam_m"] for event in reacted.manifest["events"]) < 0.6


def test_who_brakes_hard_brakes_as_hard_as_was_asked_for(reacted: Motion) -> None:
    event = reacted.manifest["events"][0]
    mine = rows(reacted)
    mine = mine[(mine.track == event["tracks"][0]) & (mine.time_s >= event["from_s"])]
    speed = mine.speed.to_numpy()
    until = int(np.argmax(speed == 0))
    assert until > 3
    assert -np.diff(speed[:until]) / 0.1 == pytest.approx(6.0, abs=0.05)
    assert (speed[until : until + 29] == 0).all()  # stands_s is 3


def test_who_runs_the_red_signal_passes_it_at_red(reacted: Motion) -> None:
    event = reacted.manifest["events"][2]
    table = reacted.signals.to_pandas()
    mine = table[(table.signal == event["signal"]) & (table.link == event["link"])]
    crossed = mine[mine.time_s <= event["crossed_s"] + 0.1].iloc[-1]
    assert crossed.state == "r"
    way = rows(reacted)
    way = way[way.track == event["tracks"][0]]
    lanes = dict(zip(way.time_s.round(3), way.lane, strict=True))
    assert lanes[round(event["crossed_s"] + 0.1, 3)].startswith(":")


def test_a_closed_lane_has_cones_and_nobody_comes_through_them(reacted: Motion) -> None:
    event = reacted.manifest["events"][3]
    shown = rows(reacted)
    cones = shown[shown["class"] == "obstacle"]
    assert set(cones.track) == set(event["tracks"])
    assert set(cones.asset) == {"cone", "barrier"}
    assert cones.time_s.min() == pytest.approx(event["from_s"], abs=0.11)
    assert cones.time_s.max() == pytest.approx(event["from_s"] + 20.0, abs=0.11)
    # The lane from the south: 3.2 m about x = 1.6, or so; the zone begins at the place.
    assert cones.y.min() == pytest.approx(-90.0, abs=0.6)
    assert np.ptp(cones.y) < 8.0
    around = Surroundings(reacted)
    ours = frozenset(event["tracks"])
    for track in event["tracks"]:
        nearest = around.nearest(around.passage(track), ours)
        assert nearest is None or nearest.gap_m > 0.0


def test_wrecks_touch_and_stay(reacted: Motion) -> None:
    event = reacted.manifest["events"][1]
    around = Surroundings(reacted)
    first, second = (around.passage(track) for track in event["tracks"][:2])
    start = max(first.time_s[0], second.time_s[0])
    first, second = (one.between(start, SECONDS) for one in (first, second))
    apart = gaps(first, second)
    after = first.time_s > event["impact_s"] + 3.0
    assert apart[first.time_s < event["impact_s"] - 0.5].min() > 0.3
    assert apart[after].max() < 0.6
    for one in (first, second):
        assert np.ptp(one.xy[after], axis=0).max() < 0.3
    overlap = [a.intersection(b).area for a, b in zip(first.boxes(), second.boxes(), strict=True)]
    assert max(overlap) < 1.0


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (
            {"event": "stalled_vehicle", "place": {"x": -146.0, "y": -2.0}, "within_s": 1.0},
            "no vehicle came",
        ),
        (
            {"event": "near_miss", "place": EAST, "pet_s": 1.0, "within_s": 0.0},
            "nobody drives past",
        ),
        ({"event": "hard_brake", "place": {"x": 0.0, "y": 0.0}}, "needs a lane of a street"),
    ],
)
def test_what_cannot_be_staged_is_told(
    quiet_twin: Twin, tmp_path: Path, event: dict[str, Any], said: str
) -> None:
    with pytest.raises(StageError, match=said):
        driven(quiet_twin, tmp_path / "m", {"at_s": 1.0, "within_m": 0.0, **event}, seconds=4.0)
    assert not (tmp_path / "m").exists()


def test_nobody_is_put_into_a_wall(quiet_twin: Twin, usual: Motion, tmp_path: Path) -> None:
    """A wall over the street, ten metres on from the place: others go where there is none."""
    walled = load_twin(quiet_twin.folder)
    corners = np.array([[-30.0, -14, -5], [-30, 14, -5], [-30, 14, 9], [-30, -14, 9]])
    brick = semantic_id("building"), material_id("brick")
    wall = LabelledMesh.build(corners, [[0, 1, 2], [0, 2, 3]], *brick)
    walled.__dict__["mesh"] = LabelledMesh.concatenate([quiet_twin.mesh, wall])
    event = {"event": "passage", "at_s": 15.0, "place": EAST, "actor": "car", **WITHIN}
    with pytest.raises(StageError, match=r"its car would come into a building at -3\d"):
        with_more(walled, usual, [{**event, "within_m": 0.0}])
    given = {"time_s": [1.0, 9.0], "x": [-40.0, -20.0], "y": [-2.0, -2.0]}
    with pytest.raises(StageError, match="its car would come into a building"):
        with_more(walled, usual, [{"event": "trajectory", "at_s": 1.0, "actor": "car", **given}])
    surface = TwinSurface(walled)
    path = PrescribedPath(
        "car", usual_asset("car", 1), np.array([1.0, 9.0]), np.array([[-40.0, -2.0], [-20.0, -2.0]])
    )
    with pytest.raises(StageError, match=r"its car would come into a building at -3\d"):
        inserted(usual, [path], surface)
    through, (track,) = inserted(usual, [path], surface, through_walls=True)
    assert (through.actors["track"].to_numpy() == track).any()
    elsewhere = with_more(walled, usual, [event])
    (staged,) = elsewhere.manifest["events"]
    assert staged["moved_m"] > 0
    hits = {one["track"] for one in elsewhere.manifest["overlaps"]["hits"]}
    assert hits  # of those who drove there before the wall stood
    assert not hits & set(staged["tracks"])


def test_the_nearest_is_the_nearest_of_all_boxes(put_in: Motion) -> None:
    """Against every pair of boxes at every step, one actor after the other."""
    around = Surroundings(put_in)
    everybody = [around.passage(track) for track in np.unique(around.track).tolist()]
    for track in np.unique(around.track).tolist()[::4]:
        mine = around.passage(track)
        least = np.inf
        for other in everybody:
            if other.length == mine.length and np.array_equal(other.xy, mine.xy):
                continue
            _, a, b = np.intersect1d(
                np.round(mine.time_s, 6), np.round(other.time_s, 6), return_indices=True
            )
            if len(a):
                least = min(least, float(gaps(mine.of_rows(a), other.of_rows(b)).min()))
        found = around.nearest(mine, frozenset({track}))
        # Who is farther away than 25 m is not looked for.
        if least < 15.0:
            assert found is not None
            assert found.gap_m == pytest.approx(least, abs=1e-9)
