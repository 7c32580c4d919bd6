"""Measurement of traffic on a twin: passages over its main junction, and statistics."""

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
    """Return the movements over a twin's main junction, and the passages of tracks over it."""
    links = JunctionLinks.of(twin.net_path, twin.roads)
    return links, passages_of(tracks, twin.roads, links)


def measuring(
    twin: Twin, tracks: list[SeenTrack], links: JunctionLinks, passages: list[Passage]
) -> Callable[[float, float], Measured]:
    """Return a function that measures tracks between two times, seconds."""
    choices = decisions_of(passages, conflicts_of(links, twin.net_path, twin.roads), links)
    return partial(measured, tracks, passages, twin.roads, decisions=choices)
