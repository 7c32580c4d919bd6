"""Traffic measured on a twin: who passed its main junction, and what it shows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from urbantwin.traffic.calibration.gap_acceptance import conflicts_of, decisions_of
from urbantwin.traffic.calibration.measured import Measured, measured
from urbantwin.traffic.calibration.passages import (
    JunctionLinks,
    Passage,
    SeenTrack,
    passages_of,
)
from urbantwin.twin import Twin

__all__ = ["measuring", "passed"]


def passed(twin: Twin, tracks: list[SeenTrack]) -> tuple[JunctionLinks, list[Passage]]:
    """Return the ways over a twin's main junction, and the tracks that passed it."""
    links = JunctionLinks.of(twin.net_path, twin.roads)
    return links, passages_of(tracks, twin.roads, links)


def measuring(
    twin: Twin, tracks: list[SeenTrack], links: JunctionLinks, passages: list[Passage]
) -> Callable[[float, float], Measured]:
    """Return what measures tracks between two moments, seconds."""
    choices = decisions_of(passages, conflicts_of(links, twin.net_path, twin.roads), links)
    return partial(measured, tracks, passages, twin.roads, decisions=choices)
