"""Critical gaps: known ones are found again in what drivers refuse and take."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.traffic.calibration.gap_acceptance import (
    Decision,
    conflicts_of,
    critical_gap,
    decisions_of,
)
from urbantwin.traffic.calibration.passages import JunctionLinks, passages_of
from urbantwin.traffic.calibration.simulated import simulated_tracks
from urbantwin.twin import Twin

SECONDS = 600.0


def choices(
    count: int, mean_s: float, spread: float, random: np.random.Generator
) -> list[tuple[float, float]]:
    """What drivers of known critical gaps do at a stream whose gaps are exponential."""
    found = []
    for _ in range(count):
        critical = random.lognormal(np.log(mean_s) - spread**2 / 2, spread)
        refused = 0.0
        while (gap := random.exponential(4.0)) < critical:
            refused = max(refused, gap)
        found.append((refused, gap if gap < 12.0 else np.inf))
    return [pair for pair in found if pair[0] > 0 or np.isfinite(pair[1])]


@pytest.mark.parametrize(("mean_s", "spread"), [(3.0, 0.2), (4.5, 0.3), (6.0, 0.1)])
def test_the_mean_critical_gap_is_found_again(mean_s: float, spread: float) -> None:
    random = np.random.Generator(np.random.Philox(7))
    found = [critical_gap(choices(300, mean_s, spread, random)) for _ in range(5)]
    assert np.mean(found) == pytest.approx(mean_s, rel=0.04)
    # A mean of taken gaps, or of refused ones, is far off: that is why both are looked at.
    taken = [gap for _, gap in choices(300, mean_s, spread, random) if np.isfinite(gap)]
    assert np.mean(taken) > 1.2 * mean_s


@pytest.fixture(scope="module")
def side_street(
    make_net: Callable[..., Path],
    twin_of: Callable[..., Twin],
    tmp_path_factory: pytest.TempPathFactory,
) -> Twin:
    """A street that a side street gives way to."""
    nodes = '<node id="a" x="0" y="0" type="priority"/><node id="w" x="-150" y="0"/>'
    nodes += '<node id="e" x="150" y="0"/><node id="s" x="0" y="-120"/>'
    pairs = [
        ("w", "a", 5),
        ("a", "w", 5),
        ("e", "a", 5),
        ("a", "e", 5),
        ("s", "a", 1),
        ("a", "s", 1),
    ]
    edges = "".join(
        f'<edge id="{one}-{other}" from="{one}" to="{other}" numLanes="1" speed="13.9" '
        f'priority="{priority}"/>'
        for one, other, priority in pairs
    )
    folder = tmp_path_factory.mktemp("side")
    return twin_of(folder / "twin", make_net(folder, nodes, edges), {"car": 0.0})


def driven(twin: Twin, critical_gap_s: float, scratch: Path) -> list[Decision]:
    rates = {("w", "e"): 250.0, ("e", "w"): 250.0, ("s", "e"): 120.0, ("s", "w"): 120.0}
    asked = {
        **twin.site["traffic"],
        **{"per_hour": {}, "warmup_s": 60.0, "seed": 3},
        "counts": [
            {"approach": f"{a}-a", "turn": f"a-{b}", "actor_class": "car", "per_hour": rate}
            for (a, b), rate in rates.items()
        ],
        "drivers": {"car": {"critical_gap_s": critical_gap_s}},
    }
    area = shapely.box(-140, -140, 140, 140)
    tracks = simulated_tracks(twin, asked, SECONDS, area, scratch=scratch, told=lambda _: None)
    links = JunctionLinks.of(twin.net_path, twin.roads)
    conflicts = conflicts_of(links, twin.net_path, twin.roads)
    # Who turns left into the street gives way to both directions, who turns right to one.
    assert {(one.minor, one.major) for one in conflicts} >= {
        (("s-a_0", "a-w"), ("w-a_0", "a-e")),
        (("s-a_0", "a-w"), ("e-a_0", "a-w")),
        (("s-a_0", "a-e"), ("w-a_0", "a-e")),
    }
    assert not [one for one in conflicts if one.minor[0] in ("w-a_0",)]
    return decisions_of(passages_of(tracks, twin.roads, links), conflicts, links)


@pytest.mark.thorough
def test_who_asks_for_longer_gaps_refuses_and_takes_longer_ones(
    side_street: Twin, tmp_path: Path
) -> None:
    usual, patient = (
        critical_gap([(one.refused_s, one.taken_s) for one in driven(side_street, gap_s, tmp_path)])
        for gap_s in (1.0, 4.0)
    )
    # HCM 2016, exhibit 20-11: 6.2 s to turn right, 7.1 s to turn left on to a street of two lanes.
    assert 4.5 < usual < 8.0
    assert 1.5 < patient - usual < 6.0
