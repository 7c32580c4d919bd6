"""Nobody drives or walks over a red light, by the network's own file and the motion's tables."""

import itertools
from collections import defaultdict
from collections.abc import Callable

import numpy as np
import pytest
from lxml import etree

from urbantwin.traffic import Motion
from urbantwin.twin import Twin

from ..thorough import further

#: The table knows the middle of who drives, at whole steps, and may have it brake a little later.
SLACK_S = 0.5


def lights_passed(
    twin: Twin, motion: Motion, *, on_foot: bool = False
) -> list[tuple[int, float, str]]:
    """Who drove from a signalled lane onto a way through its junction, when, and at which letters.

    Or who walked onto a signalled crossing.

    They are those of the link that SUMO's network gives to this way, within the slack.
    """
    link: dict[tuple[str, str], tuple[str, int]] = {}
    crossing: dict[str, tuple[str, int]] = {}
    for one in etree.parse(twin.net_path).getroot().iterfind("connection"):
        if one.get("tl"):
            light = one.get("tl"), int(one.get("linkIndex"))
            if one.get("via"):
                link[f"{one.get('from')}_{one.get('fromLane')}", one.get("via")] = light
            elif one.get("from").startswith(":"):
                crossing[f"{one.get('to')}_{one.get('toLane')}"] = light
    shown: dict[tuple[str, int], list[tuple[float, str]]] = defaultdict(list)
    for row in motion.signals.sort_by("time_s").to_pylist():
        shown[row["signal"], row["link"]].append((row["time_s"], row["state"]))
    names = ("track", "time_s", "lane")
    track, time_s, lane = (motion.actors[name].to_numpy(zero_copy_only=False) for name in names)
    order = np.lexsort([time_s, track])
    found = []
    for before, after in itertools.pairwise(order):
        key = link.get((lane[before], lane[after]))
        if on_foot:
            key = crossing.get(lane[after]) if lane[before] != lane[after] else None
        if track[before] != track[after] or key not in shown:
            continue
        letters = [letter for _, letter in shown[key]]
        times = np.array([time for time, _ in shown[key]])
        around = [time_s[after] - SLACK_S, time_s[after] + SLACK_S]
        first, last = np.maximum(np.searchsorted(times, around, side="right") - 1, 0)
        found.append((int(track[after]), float(time_s[after]), "".join(letters[first : last + 1])))
    return found


@pytest.mark.parametrize("place", ["two-avenues", *further("manchester-kingsway")])
def test_nobody_drives_over_a_red_light(
    real_drive: Callable[[str], tuple[Twin, Motion]], place: str
) -> None:
    passed = lights_passed(*real_drive(place))
    assert len(passed) >= 15
    assert [row for row in passed if set(row[2]) <= set("ru")] == []
    # And there were red lights to drive over.
    states = real_drive(place)[1].signals["state"].to_pylist()
    assert states.count("r") >= 4


@pytest.mark.parametrize("place", ["crossing", *further("manchester-kingsway")])
def test_nobody_walks_over_a_red_light(
    real_drive: Callable[[str], tuple[Twin, Motion]], place: str
) -> None:
    passed = lights_passed(*real_drive(place), on_foot=True)
    assert len(passed) >= 1
    assert [row for row in passed if set(row[2]) <= set("ru")] == []
