"""Guessed volumes, bounded by what the signals can let through.

A guess by road classes and lanes knows nothing of how streets meet. Where nobody counted, no more
is guessed than the junctions' lanes have green for (``roads.signals.capacity``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from urbantwin.roads.signals.capacity import Flows, lane_loads
from urbantwin.roads.signals.controlled_links import signalised_junctions

__all__ = ["Bound", "bound_of_signals"]

#: Lanes carry at most this share of what they could: beyond it queues grow from cycle to cycle now
#: and then (HCM 2016, 19; RiLSA 2015: 0.85 to 0.9).
FULL = 0.85


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
    found = Bound()
    for junction in signalised_junctions(etree.parse(net).getroot()):
        loads = lane_loads(junction, junction.phases, flows)
        if not loads or loads[0].load * found.share <= FULL:
            continue
        full = loads[0]
        link = next(link for link in junction.links if link.lane == full.lane)
        street = f"{link.street}, " if link.street else ""
        share = FULL / full.load
        found = Bound(
            share,
            f"of {full.flow:.0f} cars an hour that come from the {link.arm} ({street}lane "
            f"{full.lane}), its signal can let {full.capacity:.0f} through",
        )
    return found
