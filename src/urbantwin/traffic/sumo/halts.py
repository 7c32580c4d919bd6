"""Stops of buses and trams in SUMO's input."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from lxml import etree

from urbantwin.roads import BusStop
from urbantwin.traffic.demand.demand import Demand

__all__ = ["ends_of_halts", "write_stops"]

#: A repeated halt at the same stop lies this far before the previous one, metres.
AGAIN_M = 0.01


def ends_of_halts(halts: Sequence[int], stops: Sequence[BusStop]) -> Iterator[tuple[int, float]]:
    """Yield the stop and the end position, metres, of each halt.

    SUMO treats a halt at or beyond the previous one on the same street as part of the same passage.
    It would make all halts of a bus that returns to a single stop at once.
    """
    last, end_m = -1, 0.0
    for halt in halts:
        end_m = end_m - AGAIN_M if halt == last else stops[halt].end_m
        last = halt
        yield halt, end_m


def write_stops(path: Path, demand: Demand) -> None:
    """Write the stops as an additional file of SUMO."""
    root = etree.Element("additional")
    for number, stop in enumerate(demand.stops):
        where = {"startPos": f"{stop.start_m:.2f}", "endPos": f"{stop.end_m:.2f}"}
        named = {"name": stop.name} if stop.name else {}
        etree.SubElement(
            root, "busStop", id=str(number), lane=stop.lane, **where, friendlyPos="true", **named
        )
    etree.ElementTree(root).write(str(path), encoding="utf-8", xml_declaration=True)
