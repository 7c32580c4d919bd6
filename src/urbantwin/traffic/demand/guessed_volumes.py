"""Guessed volumes, bounded by what the signals can let through.

A guess by road classes and lanes knows nothing of how streets meet. Where nobody counted, no more
is guessed than the junctions' lanes have green for (``roads.signals.capacity``), nor than finds
room between signals that are near each other (``roads.signals.queue_model``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from urbantwin.roads.signals.capacity import Flows, LaneLoad, lane_loads
from urbantwin.roads.signals.controlled_links import Signalised, signalised_junctions
from urbantwin.roads.signals.coordination import COORDINATED_M
from urbantwin.roads.signals.inner_links import feeds
from urbantwin.roads.signals.queue_model import QueueModel

__all__ = ["Bound", "bound_of_signals"]

#: Lanes carry at most this share of what they could: beyond it queues grow from cycle to cycle now
#: and then (HCM 2016, 19; RiLSA 2015: 0.85 to 0.9).
FULL = 0.85
#: Shares of a guess that are tried in steps of this, and what a lane may leave over of what comes.
STEP, LEFT_OVER = 0.02, 0.05


@dataclass(frozen=True)
class Bound:
    """How much of a guess the signals can let through.

    Attributes:
        share: of the motor traffic guessed, 1 where it is all.
        because: the lane that is full first, and what it can carry; empty where none is.
    """

    share: float = 1.0
    because: str = ""

    def of(self, per_hour: Mapping[str, float], motor: Mapping[str, float]) -> dict[str, float]:
        """Return volumes by class, those of motor vehicles lowered."""
        return {
            name: count * (self.share if name in motor else 1.0) for name, count in per_hour.items()
        }


def bound_of_signals(net: Path, flows: Flows) -> Bound:
    """Return how much of some flows the signals of a network can let through.

    Args:
        net: the SUMO network, with its programs.
        flows: cars an hour.
    """
    root = etree.parse(net).getroot()
    junctions = signalised_junctions(root)
    found = Bound()
    for junction in junctions:
        loads = lane_loads(junction, junction.phases, flows)
        if not loads or loads[0].load * found.share <= FULL:
            continue
        through = f"its signal can let {loads[0].capacity:.0f} through"
        found = Bound(FULL / loads[0].load, f"{_who(loads[0])}, {through}")
    near = _near(root, junctions, flows)
    return near if near.share < found.share else found


def _near(root: etree._Element, junctions: Sequence[Signalised], flows: Flows) -> Bound:
    """Return how much finds room between signals that are near each other."""
    ways = feeds(root, junctions, COORDINATED_M)
    programs = {junction.program: junction.phases for junction in junctions}
    model = QueueModel(junctions, programs, ways, flows)
    if not model.lanes or not np.isfinite(model.room_m).any():
        return Bound()
    scale = np.arange(STEP, 1.0 / FULL + STEP, STEP)
    late = np.array([[round(junction.offset) for junction in junctions]], np.int64)
    queues = model.run(np.repeat(late, len(scale), axis=0), scale)
    fails = np.flatnonzero(queues.worst > LEFT_OVER)
    if not len(fails):
        return Bound()
    first = int(fails[0])
    lane = int(np.argmax(queues.left_over[first]))
    one, ahead = model.lanes[lane], model.ahead(lane)
    fits = one.flow * max(float(scale[first]) - STEP, STEP)
    through = f"no more than {fits:.0f} leave"
    if ahead is not None:
        onward = f"{model.room_m[ahead]:.0f} m to the signal on lane {model.lanes[ahead].lane}"
        through = f"the {onward} have room for {fits:.0f}"
    return Bound(min(FULL * fits / one.flow, 1.0), f"{_who(one)}, {through}")


def _who(one: LaneLoad) -> str:
    """Return who comes by a lane."""
    link = next(iter(one.links))
    street = f"{link.street}, " if link.street else ""
    return f"of {one.flow:.0f} cars an hour that come from the {link.arm} ({street}lane {one.lane})"
