"""Guessed volumes, bounded by what the signals can let through.

A guess by road classes and lanes knows nothing of how streets meet. Where nobody counted, no more
is guessed than the junctions' lanes have green for (``roads.signals.capacity``), nor than finds
room between signals that are near each other (``roads.signals.queue_model``). Only those stay away
whose way leads over a lane that is full; everybody else comes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.roads.signals.capacity import Flows, LaneLoad, lane_loads
from urbantwin.roads.signals.controlled_links import Signalised, signalised_junctions
from urbantwin.roads.signals.coordination import COORDINATED_M
from urbantwin.roads.signals.inner_links import Feed, feeds
from urbantwin.roads.signals.queue_model import QueueModel
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.demand import Bound

__all__ = ["bounded_by_signals", "share_of_motor"]

#: A guess loads lanes to at most this share of their capacity. Standards plan for 0.85 to 0.9 (HCM
#: 2016, chapter 19; RiLSA 2015), beyond which queues grow from cycle to cycle now and then. They
#: do not count people on foot who hold up turns, nor vehicles that wait on a junction: simulated
#: hours of ten places carry 0.62 to 0.75.
FULL = 0.62
#: Multiples of the traffic that are tried in steps of this, and what a lane may leave over of what
#: comes.
STEP, LEFT_OVER = 0.02, 0.05
#: Loads depend on what else comes, so they are worked out anew so often, and ways over a lane that
#: is full are lowered by this factor at most each time.
ROUNDS, LEAST = 40, 0.75
#: Movements that have a smaller share of a lane are not what fills it.
LITTLE = 0.05

#: (edge, next edge) -> share of the traffic that is left there.
_Cuts = dict[tuple[str, str], float]


@dataclass(frozen=True)
class _Full:
    """A lane that more come to than pass, what lets no more through, and the share that passes."""

    lane: LaneLoad
    through: str
    share: float


def bounded_by_signals(net: Path, circulation: Circulation) -> tuple[Circulation, Bound]:
    """Return who circulates of a guess, and how much of it that is.

    Args:
        net: the SUMO network, with its programs.
        circulation: as guessed.
    """
    root = etree.parse(net).getroot()
    junctions = signalised_junctions(root)
    near = feeds(root, junctions, COORDINATED_M)
    guessed, why = circulation, dict[str, _Full]()
    for _ in range(ROUNDS):
        flows = circulation.flows()
        cuts: _Cuts = {}
        for one in _full(junctions, flows):
            through = f"its signal lets {FULL * one.capacity:.0f} through without lasting queues"
            why.setdefault(one.lane, _Full(one, through, FULL / one.load))
            _cut(cuts, one, FULL / one.load)
        if not cuts:
            found = _without_room(junctions, near, flows)
            if found is None:
                break
            why.setdefault(found.lane.lane, found)
            _cut(cuts, found.lane, found.share)
        circulation = circulation.lowered(cuts, IN_CARS.keys())
    return circulation, Bound(share_of_motor(circulation, guessed), _reason(why.values()))


def share_of_motor(circulation: Circulation, guessed: Circulation) -> float:
    """Return how many motor vehicles come in by the hour of those who were guessed."""
    come, all_of_them = (
        sum(one.per_hour[name] for name in sorted(IN_CARS)) for one in (circulation, guessed)
    )
    return come / all_of_them if all_of_them else 1.0


def _full(junctions: Sequence[Signalised], flows: Flows) -> list[LaneLoad]:
    """Return the lanes that have less green than comes, a little more than that aside."""
    loads = (one for item in junctions for one in lane_loads(item, item.phases, flows))
    return [one for one in loads if one.load > FULL * (1.0 + STEP / 2)]


def _cut(cuts: _Cuts, one: LaneLoad, share: float) -> None:
    """Lower the ways over a lane to a share."""
    for link, flow in one.links.items():
        if flow > LITTLE * one.flow:
            way = link.road, link.to.rpartition("_")[0]
            cuts[way] = min(cuts.get(way, 1.0), max(share, LEAST))


def _without_room(
    junctions: Sequence[Signalised], near: Sequence[Feed], flows: Flows
) -> _Full | None:
    """Return the lane between signals near each other that first does not empty, if any."""
    model = QueueModel(junctions, {item.program: item.phases for item in junctions}, near, flows)
    if not model.lanes or not np.isfinite(model.room_m).any():
        return None
    scale = np.arange(STEP, 1.0 / FULL + STEP, STEP)
    late = np.array([[round(junction.offset) for junction in junctions]], np.int64)
    queues = model.run(np.repeat(late, len(scale), axis=0), scale)
    fails = np.flatnonzero(queues.worst > LEFT_OVER)
    if not len(fails):
        return None
    first = int(fails[0])
    lane = int(np.argmax(queues.left_over[first]))
    one, ahead = model.lanes[lane], model.ahead(lane)
    fits = max(float(scale[first]) - STEP, STEP)
    through = f"no more than {one.flow * fits:.0f} leave"
    if ahead is not None:
        onward = f"{model.room_m[ahead]:.0f} m to the signal on lane {model.lanes[ahead].lane}"
        through = f"the {onward} have room for {one.flow * fits:.0f}"
    return _Full(one, through, min(FULL * fits, 1.0 - STEP))


def _reason(why: Iterable[_Full]) -> str:
    """Return what holds up whom, where most of them have to stay away."""
    told = sorted(why, key=lambda one: (-one.lane.flow * (1.0 - one.share), one.lane.lane))
    if not told:
        return ""
    others = len(told) - 1
    more = f"; as on {others} more lane{'s' * (others > 1)}" if others else ""
    return f"{_who(told[0].lane)}, {told[0].through}{more}"


def _who(one: LaneLoad) -> str:
    """Return who comes by a lane."""
    link = next(iter(one.links))
    street = f"{link.street}, " if link.street else ""
    return f"of {one.flow:.0f} cars an hour that come from the {link.arm} ({street}lane {one.lane})"
