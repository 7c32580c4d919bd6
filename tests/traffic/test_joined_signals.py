"""Signals of two junctions with one program: each link gets the group that lets vehicles pass."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from urbantwin.traffic.calibration.passages import JunctionLinks, Passage, SeenTrack
from urbantwin.traffic.calibration.signal_timing import groups_of_links, timing_of
from urbantwin.traffic.recorded.track import RecordedSignals, RecordedTrack
from urbantwin.twin import Twin

#: Green of two groups in a cycle of 60 s: at the first junction, then at the second.
GREENS = {"first": (0.0, 20.0), "second": (30.0, 50.0)}
SECONDS = 900.0


@pytest.fixture(scope="module")
def joined(
    make_net: Callable[..., Path],
    twin_of: Callable[..., Twin],
    tmp_path_factory: pytest.TempPathFactory,
) -> Twin:
    """Two crossings 40 m apart, one program."""
    places = {"w": (-160, 0), "e": (160, 0), "an": (-20, 90), "as": (-20, -90)}
    places |= {"bn": (20, 90), "bs": (20, -90)}
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="0" type="traffic_light" tl="both"/>'
        for name, x in (("a", -20), ("b", 20))
    ) + "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in places.items())
    pairs = [("w", "a"), ("a", "b"), ("e", "b"), ("an", "a"), ("as", "a"), ("bn", "b"), ("bs", "b")]
    edges = "".join(
        f'<edge id="{one}-{two}" from="{one}" to="{two}" numLanes="1" speed="13.9"/>'
        for pair in pairs
        for one, two in (pair, pair[::-1])
    )
    folder = tmp_path_factory.mktemp("joined")
    return twin_of(folder / "twin", make_net(folder, nodes, edges), {"car": 0.0})


def test_links_of_the_other_junction_are_told_too(joined: Twin) -> None:
    links = JunctionLinks.of(joined.net_path, joined.roads)
    main, other = links.junction, "b" if links.junction == "a" else "a"
    near = f"{other}-{main}"
    first, last = {"a": ("e-b", "a-w"), "b": ("w-a", "b-e")}[main]
    assert all(lane.split("_")[0].endswith(f"-{other}") for lane, _ in links.beside)
    (there,) = links.beside[f"{first}_0", near]
    (here,) = links.links[f"{near}_0", last]
    shown = {
        group: (
            (-1.0, "r"),
            *(
                change
                for cycle in np.arange(0.0, SECONDS, 60.0)
                for change in ((cycle + on, "G"), (cycle + off, "y"), (cycle + off + 3, "r"))
            ),
        )
        for group, (on, off) in GREENS.items()
    }
    lanes = np.array([f"{first}_0"] * 20 + [""] + [f"{near}_0"] * 20 + ["", f"{last}_0"], object)
    passages = []
    for number in range(12):
        times = 60.0 * number + 5.0 + np.r_[np.linspace(-8, 0, 20), np.linspace(1, 29, 21), 31, 32]
        nothing = np.full(len(times), np.nan)
        xy = np.zeros((len(times), 2))
        track = RecordedTrack(
            str(number), "car", times, xy, nothing, nothing, np.array([4.5, 1.8, 1.5])
        )
        seen = SeenTrack(track, times, xy, nothing, np.full(len(times), 5.0))
        passages.append(Passage(seen, lanes, near, last, f"{near}_0", float(times[40])))
    signals = RecordedSignals(shown)
    group_of = groups_of_links(signals, passages, links, SECONDS)
    assert group_of[there] == "first"
    assert group_of[here] == "second"
    timing = timing_of(signals, passages, links, SECONDS)
    assert timing is not None
    green = {
        link: sum(seconds for seconds, state in timing.states if state[link] in "Gg")
        for link in (there, here)
    }
    assert green == pytest.approx({there: 20.0, here: 20.0}, abs=3.0)
