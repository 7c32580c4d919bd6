"""Calibration: what is known of a simulation is found again in what was seen of it."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from urbantwin.traffic.calibration.agreement import (
    agreement,
    chance_between,
    own_spread,
    spread_of,
)
from urbantwin.traffic.calibration.drivers import fitted_drivers, of_approaches, of_classes
from urbantwin.traffic.calibration.gap_acceptance import Decision, conflicts_of, decisions_of
from urbantwin.traffic.calibration.measured import Measured, measured
from urbantwin.traffic.calibration.parameters import traffic_of
from urbantwin.traffic.calibration.passages import JunctionLinks, Passage, SeenTrack, passages_of
from urbantwin.traffic.calibration.signal_timing import timing_of
from urbantwin.traffic.calibration.simulated import simulated_tracks
from urbantwin.traffic.recorded.track import RecordedSignals
from urbantwin.traffic.sumo.counted_signals import timing_told
from urbantwin.twin import Twin

SECONDS, WARMUP_S = 360.0, 60.0
#: Who drives: as nobody does by default.
TRUTH = {
    "speed_factor": 0.8,
    "speed_spread": 0.05,
    "headway_s": 1.6,
    "queue_headway_s": 2.2,
    "standing_gap_m": 3.2,
    "acceleration": 1.9,
    "acceleration_at_10": 1.1,
    "sideways_acceleration": 3.0,
    "critical_gap_s": 3.0,
}
#: Who turns left from the east looks for gaps in what comes from the west.
FLOWS = {
    ("wc", "ce"): 400.0,
    ("wc", "cs"): 150.0,
    ("ec", "cw"): 350.0,
    ("ec", "cs"): 180.0,
    ("nc", "cs"): 250.0,
}


@pytest.fixture(scope="module")
def links(crossing_twin: Twin) -> JunctionLinks:
    return JunctionLinks.of(crossing_twin.net_path, crossing_twin.roads)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sumo")


@pytest.fixture(scope="module")
def tracks(crossing_twin: Twin, scratch: Path) -> list[SeenTrack]:
    asked = {
        **crossing_twin.site["traffic"],
        "per_hour": {},
        "warmup_s": WARMUP_S,
        "counts": [
            {"approach": start, "turn": end, "actor_class": "car", "per_hour": rate}
            for (start, end), rate in FLOWS.items()
        ],
        "drivers": {"car": TRUTH},
    }
    return simulated_tracks(
        crossing_twin,
        asked,
        SECONDS,
        shapely.box(-140, -140, 140, 140),
        scratch=scratch,
        told=lambda _: None,
    )


@pytest.fixture(scope="module")
def passages(tracks: list[SeenTrack], crossing_twin: Twin, links: JunctionLinks) -> list[Passage]:
    return passages_of(tracks, crossing_twin.roads, links)


@pytest.fixture(scope="module")
def whole(
    tracks: list[SeenTrack], passages: list[Passage], crossing_twin: Twin, links: JunctionLinks
) -> Measured:
    decisions = decided(passages, crossing_twin, links)
    return measured(tracks, passages, crossing_twin.roads, 0.0, SECONDS, decisions=decisions)


def decided(passages: list[Passage], twin: Twin, links: JunctionLinks) -> list[Decision]:
    return decisions_of(passages, conflicts_of(links, twin.net_path, twin.roads), links)


def test_everybody_is_found_on_the_way_that_was_taken(whole: Measured) -> None:
    assert set(whole.turns) == set(FLOWS)
    for way, rate in FLOWS.items():
        # Who sets out evenly passes in platoons: a cycle's worth may be missing or too many.
        assert whole.turns[way] == pytest.approx(rate * SECONDS / 3600, abs=rate * 60 / 3600 + 2)


def test_who_goes_round_and_passes_again_is_counted_each_time(
    passages: list[Passage], crossing_twin: Twin, links: JunctionLinks
) -> None:
    """Two who passed are joined to one who is out of sight in between; nothing else changes."""
    whole = [one for one in passages if one.approach and one.leaving]
    pairs = list(zip(whole[:20], whole[20:40], strict=True))

    def joined(first: SeenTrack, second: SeenTrack) -> SeenTrack:
        later = second.time_s + first.time_s[-1] + 30.0 - second.time_s[0]
        both = ("xy", "yaw", "speed")
        columns = (np.concatenate([getattr(one, name) for one in (first, second)]) for name in both)
        return SeenTrack(first.track, np.concatenate([first.time_s, later]), *columns)

    round_again = [joined(one.seen, other.seen) for one, other in pairs]
    found = passages_of(round_again, crossing_twin.roads, links)
    wanted = [(one.approach, one.leaving) for pair in pairs for one in pair]
    assert [(one.approach, one.leaving) for one in found] == wanted
    for (one, other), first, second in zip(pairs, found[::2], found[1::2], strict=True):
        assert first.passed_s == one.passed_s
        moved = first.seen.time_s[-1] + 30.0 - other.seen.time_s[0]
        assert second.passed_s == pytest.approx(other.passed_s + moved)


def test_flows_and_sizes_are_found_again(
    whole: Measured, passages: list[Passage], tracks: list[SeenTrack]
) -> None:
    sizes = {"car": np.array([one.track.size for one in tracks])}
    traffic, _ = traffic_of(whole, passages, sizes, 0.0)
    counted = {(row["approach"], row["turn"]): row["per_hour"] for row in traffic["counts"]}
    assert counted == {
        way: pytest.approx(count * 3600 / SECONDS, abs=0.1) for way, count in whole.turns.items()
    }
    assert traffic["size"]["car"]["length"] == pytest.approx(1.0, abs=0.1)
    assert max(float(speeds.max()) for speeds in whole.speeds) < 0.8 * 13.9 * 1.15


@pytest.mark.thorough
def test_drivers_are_found_again(
    whole: Measured, crossing_twin: Twin, links: JunctionLinks, scratch: Path
) -> None:
    counts = [
        {"approach": a, "turn": b, "actor_class": "car", "per_hour": n * 3600 / SECONDS}
        for (a, b), n in whole.turns.items()
    ]
    seen, shorter_s = shapely.box(-140, -140, 140, 140), 180.0

    def simulated(drivers: Mapping[str, float], turn: int) -> Measured:
        asked = {
            **crossing_twin.site["traffic"],
            **{"per_hour": {}, "warmup_s": WARMUP_S, "counts": counts},
            **{"drivers": of_classes(drivers, ["car"]), "seed": 99},
            "approaches": [
                {"approach": road, "queue_headway_s": value}
                for road, value in of_approaches(drivers).items()
            ],
        }
        again = simulated_tracks(
            crossing_twin, asked, shorter_s, seen, scratch=scratch, told=lambda _: None
        )
        passed = passages_of(again, crossing_twin.roads, links)
        decisions = decided(passed, crossing_twin, links)
        return measured(again, passed, crossing_twin.roads, 0.0, shorter_s, decisions=decisions)

    found, told, untold = fitted_drivers(whole, simulated, rounds=3)
    assert untold == []
    (headway,) = (one for one in told if one["field"] == "headway_s")
    assert 0 < headway["standard_error"] < 0.1 * TRUTH["headway_s"]
    assert {one["field"] for one in told} == set(TRUTH) == {one.split()[0] for one in found}
    assert found["headway_s"] == pytest.approx(TRUTH["headway_s"], rel=0.1)
    for name in (one for one in found if one.startswith("queue_headway_s")):
        assert found[name] == pytest.approx(TRUTH["queue_headway_s"], rel=0.2), name
    assert found["standing_gap_m"] == pytest.approx(TRUTH["standing_gap_m"], rel=0.1)
    # Of some fifteen who met oncoming traffic; the search begins at 1 s.
    assert found["critical_gap_s"] == pytest.approx(TRUTH["critical_gap_s"], abs=1.0)
    # Half of those who set out are held up by who is ahead: their accelerations tell less.
    for field, off in (
        *(("speed_factor", 0.12), ("acceleration", 0.2)),
        *(("acceleration_at_10", 0.12), ("sideways_acceleration", 0.12)),
    ):
        assert found[field] == pytest.approx(TRUTH[field], rel=off), field


@pytest.fixture(scope="module")
def shown(
    tracks: list[SeenTrack], crossing_twin: Twin, scratch: Path
) -> tuple[float, dict[str, tuple[tuple[float, str], ...]]]:
    """The cycle of the program that was simulated, which is timed for who was counted, and what
    each of its links showed."""
    (program,) = timing_told(scratch / "counted.net.xml", crossing_twin.roads)[0].programs
    cycle = sum(seconds for seconds, _ in program.phases)
    states = []  # of every link, each second
    for second in range(round(SECONDS)):
        at = (second + WARMUP_S - program.offset) % cycle
        for seconds, state in program.phases:
            if at < seconds:
                states.append(state)
                break
            at -= seconds
    # A group for every link, by names that tell nothing.
    shown = {}
    for link in range(len(states[0])):
        letters = [state[link] for state in states]
        changes = [k for k in range(len(letters)) if k == 0 or letters[k] != letters[k - 1]]
        shown[f"group {link}"] = tuple((float(k), letters[k]) for k in changes)
    return cycle, shown


def test_groups_of_signals_are_told_by_who_passes(
    links: JunctionLinks, passages: list[Passage], shown: Any
) -> None:
    cycle, shown = shown
    timing = timing_of(RecordedSignals(shown), passages, links, SECONDS)
    assert timing is not None
    assert timing.cycle_s == pytest.approx(cycle, abs=0.5)
    taken = Counter(
        number
        for one in passages
        if np.isfinite(one.passed_s)
        for number in links.links.get((one.lane, one.leaving), ())
    )
    often = [link for link, count in taken.items() if count >= 8]
    assert len(often) >= 3
    for link in often:
        green = {
            name: [at for at, letter in changes if letter in "Gg"]
            for name, changes in (("own", shown[f"group {link}"]),)
        }["own"]
        found = [at for at, letter in shown[timing.group_of[link]] if letter in "Gg"]
        # One that is green less often, whenever those passed who took the link, is as likely.
        assert set(found) <= set(green)
    assert sum(seconds for seconds, _ in timing.states) == pytest.approx(cycle, abs=0.5)


def test_a_green_begins_once_that_gets_right_of_way(
    links: JunctionLinks, passages: list[Passage], shown: Any
) -> None:
    """The cycle is told by beginnings, also of groups that have green twice in it."""
    cycle, shown = shown
    halved = {
        name: tuple(
            row
            for at, letter in changes
            for row in (((at, "g"), (at + 4.0, "G")) if letter in "Gg" else ((at, letter),))
        )
        for name, changes in shown.items()
    }
    begins = np.arange(3.0, SECONDS, cycle / 2)
    halved["twice"] = tuple(
        row for at in begins for row in ((at, "G"), (at + 9.0, "y"), (at + 12.0, "r"))
    )
    timing = timing_of(RecordedSignals(halved), passages, links, SECONDS)
    assert timing is not None
    assert timing.cycle_s == pytest.approx(cycle, abs=0.5)


def test_people_have_green_when_nobody_who_would_meet_them_has(
    links: JunctionLinks, passages: list[Passage], shown: Any, crossing_twin: Twin
) -> None:
    """As in the program that was simulated, whose groups of people no passage tells."""
    timing = timing_of(RecordedSignals(shown[1]), passages, links, SECONDS)
    assert timing is not None
    assert links.signals is not None
    letters = np.array(
        [list(state) for seconds, state in timing.states for _ in range(round(10 * seconds))]
    )
    crossings = [one for one in links.signals.links if one.movement == "walk"]
    assert len(crossings) == 4
    for walk in crossings:
        walks = letters[:, walk.index] == "G"
        assert 5.0 <= walks.sum() / 10 < shown[0] - walk.length / 1.2
        still = round(10 * walk.length / 1.4)  # somebody who set out last, at 1.4 m/s
        there = np.any([np.roll(walks, k) for k in range(still)], axis=0)
        arm = next(iter(walk.crosses)).replace("c", "")
        ways = [
            one.index
            for one in links.signals.links
            if one.road == f"{arm}c" or (one.to[:2] == f"c{arm}" and one.movement == "through")
        ]
        assert ways
        assert not np.isin(letters[there][:, ways], ["G", "g", "y"]).any(), arm


@pytest.mark.thorough
def test_a_measurement_agrees_with_itself_and_not_with_another(
    whole: Measured,
    tracks: list[SeenTrack],
    passages: list[Passage],
    crossing_twin: Twin,
    links: JunctionLinks,
) -> None:
    same = agreement(whole, whole)
    assert (same["speed_ks"], same["headway_ks"], same["turn_shares_points"]) == (0, 0, 0)
    slow = [
        SeenTrack(one.track, one.time_s, one.xy, one.yaw, one.speed / 2)
        for one in tracks
        if one.track.actor_class == "car"
    ]
    other = measured(
        slow, passages_of(slow, crossing_twin.roads, links), crossing_twin.roads, 0.0, SECONDS
    )
    assert agreement(whole, other)["speed_ks"] > 0.5
    spread = own_spread(whole)
    assert 0 < spread["speed_ks"]["median"] < spread["speed_ks"]["p95"] < 0.4
    parts = [
        measured(tracks, passages, crossing_twin.roads, at, at + 40.0)
        for at in np.arange(0.0, SECONDS, 40.0)
    ]
    chance = spread_of(parts, whole)
    assert chance is not None
    assert spread_of(parts[:3], whole) is None
    assert 0 < chance["turn_shares_points"]["median"] <= chance["turn_shares_points"]["p95"]
    alike = spread_of([whole] * 8, whole)
    assert alike is not None
    assert alike["speed_ks"] == {"median": 0.0, "p95": 0.0}


@pytest.mark.thorough
def test_chance_between_two_parts_is_that_of_draws_from_one_street() -> None:
    """One pair of parts tells what many pairs of one truth differ by (closed: multinomial)."""
    random = np.random.default_rng(5)
    nothing = Measured(1.0, {}, {}, {})

    def part(count: int) -> Measured:
        new = dict(zip("abcd", random.multinomial(count, [0.7, 0.15, 0.1, 0.05]), strict=True))
        speeds = tuple(random.normal(9, 2, 20) + random.normal(0, 1) for _ in range(count // 4))
        lanes = {"x": random.exponential(5, count).tolist()}
        return replace(nothing, new=new, turns=new, speeds=speeds, headways=lanes)

    told = chance_between(part(600), part(400))
    pairs = [agreement(part(600), part(400)) for _ in range(200)]
    for name, one in told.items():
        seen = np.quantile([pair[name] for pair in pairs], [0.5, 0.95])
        assert (one["median"], one["p95"]) == pytest.approx(tuple(seen), rel=0.25), name
    assert chance_between(nothing, nothing) == dict.fromkeys(told)


def test_at_signals_gaps_count_between_ways_that_are_green_together(
    crossing_twin: Twin, links: JunctionLinks
) -> None:
    """Turning left meets who comes towards it; who crosses has green at another time."""
    conflicts = conflicts_of(links, crossing_twin.net_path, crossing_twin.roads)
    met = {one.major[0].split("_")[0] for one in conflicts if one.minor == ("ec_2", "cs")}
    assert met == {"wc"}
    assert not [one for one in conflicts if one.minor[1] == "ce" and one.minor[0].startswith("wc")]
