"""Critical gaps: of drivers whose critical gaps are known, and of ways drawn by hand."""

import numpy as np
import pytest

from urbantwin.traffic.calibration.gap_acceptance import GapChoice, critical_gap_s, gap_choices
from urbantwin.traffic.calibration.passages import JunctionLinks, Passage, SeenTrack
from urbantwin.traffic.recorded.track import RecordedTrack

MINOR, MAJOR = ("minor_0", "north"), ("major_0", "east")


def choices_of(mean_s: float, spread_s: float, flow_s: float, drivers: int) -> list[GapChoice]:
    """Drivers with log-normal critical gaps before gaps of a random stream, one of so many s."""
    random = np.random.default_rng(4)
    variance = np.log(1 + (spread_s / mean_s) ** 2)
    critical = random.lognormal(np.log(mean_s) - variance / 2, np.sqrt(variance), drivers)
    found = []
    for one in critical:
        left = 0.0
        while (gap := random.exponential(flow_s)) < one:
            left = max(left, gap)
        found.append(GapChoice(left, gap))
    return found


@pytest.mark.parametrize(("mean_s", "spread_s"), [(3.0, 0.5), (5.0, 1.2)])
@pytest.mark.parametrize("flow_s", [4.0, 9.0])
def test_mean_critical_gap_of_known_drivers(mean_s: float, spread_s: float, flow_s: float) -> None:
    choices = choices_of(mean_s, spread_s, flow_s, 600)
    assert critical_gap_s(choices) == pytest.approx(mean_s, rel=0.04)
    # What was taken is longer, and what was left shorter: neither is the critical gap.
    assert np.mean([one.taken_s for one in choices]) > 1.3 * mean_s
    assert np.mean([one.left_s for one in choices]) < 0.8 * mean_s
    patient = [one for one in choices if one.left_s > 0]
    assert critical_gap_s(patient) > 1.03 * mean_s


def test_gaps_without_an_end_and_drivers_who_contradict_themselves_count() -> None:
    choices = choices_of(4.0, 0.6, 6.0, 400)
    endless = [GapChoice(one.left_s, np.inf if one.taken_s > 9 else one.taken_s) for one in choices]
    assert critical_gap_s(endless) == pytest.approx(4.0, rel=0.04)
    assert np.isfinite(critical_gap_s([GapChoice(5.0, 4.0), GapChoice(3.0, np.inf)]))


def passage(way: tuple[str, str], xy: np.ndarray, time_s: np.ndarray, passed_s: float) -> Passage:
    speed = np.linalg.norm(np.gradient(xy, time_s, axis=0), axis=1)
    yaw, nothing = np.zeros(len(xy)), np.full(len(xy), np.nan)
    track = RecordedTrack(str(passed_s), "car", time_s, xy, yaw, nothing, np.array([4.4, 1.8, 1.5]))
    seen = SeenTrack(track, time_s, xy, yaw, speed)
    return Passage(seen, np.full(len(xy), way[0], object), way[0], way[1], way[0], passed_s)


def crossed(at_s: float) -> Passage:
    """A vehicle with priority, 10 m/s to the east, that is at (0, 10) then."""
    time_s = np.arange(-4.0, 4.01, 0.1)
    xy = np.column_stack([10.0 * time_s, np.full(len(time_s), 10.0)])
    return passage(MAJOR, xy, time_s + at_s, at_s - 0.8)


def test_gaps_that_were_left_and_taken_are_those_at_the_place_where_ways_meet() -> None:
    """It stands at the stop line from 2 to 11 s, 10 m before the others' way, and goes at 5 m/s."""
    time_s = np.arange(0.0, 15.01, 0.1)
    ahead = np.where(time_s < 2, 5.0 * (time_s - 2), np.maximum(5.0 * (time_s - 11), 0.0))
    waits = passage(MINOR, np.column_stack([0 * ahead, ahead]), time_s, 11.0)
    others = [crossed(at) for at in (0.5, 3.0, 5.5, 9.5, 10.8, 15.5)]
    links = JunctionLinks("j", {}, {}, None, {MINOR: frozenset({MAJOR})})
    (choice,) = gap_choices([waits, *others], links, 0.0, 20.0)
    # It has 9.3 m to where the ways meet, to a metre; there it is at about 12.9 s.
    assert choice.left_s == pytest.approx(4.0, abs=0.05)
    assert choice.taken_s == pytest.approx(4.7, abs=0.05)
    assert gap_choices([waits, *others], links, 0.0, 10.0) == []
    # At signals it may have stood before red: only from the stop line on it looks for a gap.
    lit = JunctionLinks("j", {}, {MINOR: (0,)}, None, links.prior)
    (last,) = gap_choices([waits, *others], lit, 0.0, 20.0)
    assert last.left_s == 0.0
    assert last.taken_s == pytest.approx(4.5, abs=0.05)
    # Who has priority looks for no gap.
    assert gap_choices([waits, *others], JunctionLinks("j", {}, {}, None, {}), 0.0, 20.0) == []
