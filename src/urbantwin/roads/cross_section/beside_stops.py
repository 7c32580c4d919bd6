"""Footways beside bus stops: where people wait there is something to stand on.

A street that the map gives no sidewalk, by a tag or by its class, has one where a bus stop is
mapped beside it, as far as its next junctions, where people come from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.cross_section.defaults import standard_of
from urbantwin.roads.cross_section.section import CrossSection
from urbantwin.roads.cross_section.segment import Segment

__all__ = ["with_footways_at_stops"]

#: A stop's pole or platform is so far from the outermost lane of its street at most, metres.
BESIDE_M = 10.0


def with_footways_at_stops(
    segments: Sequence[Segment],
    sections: Sequence[CrossSection],
    stops: NDArray[np.float64],
    country: str,
) -> list[CrossSection]:
    """Return the cross sections, with a sidewalk on the side of each stop.

    Args:
        segments: parts of ways.
        sections: their cross sections.
        stops: (N, 2) poles and platforms where buses halt, site frame.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    result = list(sections)
    lines = shapely.STRtree([shapely.LineString(one.piece.points) for one in segments])
    width = standard_of(country).sidewalk
    for stop in stops:
        near = []
        for k in lines.query(shapely.Point(stop).buffer(4 * BESIDE_M)).tolist():
            side, away = _side_of(segments[k], sections[k], lines.geometries[k], stop)
            if segments[k].piece.way and side and away < BESIDE_M:
                near.append((away, k, side))
        if not near:
            continue
        _, k, side = min(near)
        beside = getattr(result[k], side)
        if not beside.sidewalk:
            new = replace(beside, sidewalk=width, shoulder=0.0)
            result[k] = replace(result[k], **{side: new})
    return result


def _side_of(
    segment: Segment, section: CrossSection, line: shapely.LineString, stop: NDArray[np.float64]
) -> tuple[str, float]:
    """Return on which side of a street a stop is, empty if nobody gets on there, and how far."""
    at = float(np.clip(line.project(shapely.Point(stop)), 0.5, max(line.length - 0.5, 0.5)))
    a, b = (shapely.get_coordinates(line.interpolate(at + d))[0] for d in (-0.5, 0.5))
    away, ahead = stop - (a + b) / 2, (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    left = float(ahead[0] * away[1] - ahead[1] * away[0])
    side = "left" if left > 0 else "right"
    forward = (side == "left") == (section.driving_side == "left")
    lanes = section.lanes(forward=forward)
    buses = any("bus" in lane.allowed for lane in lanes)
    both = bool(section.forward and section.backward)
    reach = sum(lane.width for lane in lanes) / (1 if both else 2)
    return side if buses else "", float(np.linalg.norm(away)) - reach
