"""Lane widths on superelevated roads: measured along the surface, unchanged in plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urbantwin.roads.model import LaneModel, LaneSection, ModelRoad, Profile, fitted

__all__ = ["with_banked_widths"]

#: Smaller differences are ignored, metres.
NOTICED_M = 0.004


def with_banked_widths(model: LaneModel) -> LaneModel:
    """Return a model with its widths converted from plan to the banked surface.

    A road with superelevation is rotated about its reference line, and offsets and widths are
    measured in the rotated plane (ASAM OpenDRIVE 1.8, 10.5): in plan they are shorter by its
    cosine.
    """
    return model.with_roads(tuple(_road(road) for road in model.roads))


def _road(road: ModelRoad) -> ModelRoad:
    s = np.linspace(0.0, road.length, max(2, int(np.ceil(road.length)) + 1))
    shrink = 1.0 - np.cos(road.bank.at(s)).min()
    if shrink == 0.0:
        return road
    if shrink == 0.0:
        return road
    if _lane_extent(road) * shrink < NOTICED_M:
        return road
    sections = tuple(
        _section(road, section, end)
        for section, end in zip(road.sections, road.section_ends, strict=True)
    )
    return replace(road, offset=_grown(road, road.offset, 0.0, road.length), sections=sections)


def _lane_extent(road: ModelRoad) -> float:
    """Return the extent of lanes from the reference line at the road's start, metres."""
    reach = 0.0
    for side in (1, -1):
        t = float(road.offset.at(0.0)[0])
        lanes = (lane for lane in road.sections[0].lanes if lane.id * side > 0)
        for lane in sorted(lanes, key=lambda lane: lane.id * side):
            t += side * float(lane.width.at(0.0)[0])
            reach = max(reach, abs(t))
    return reach


def _section(road: ModelRoad, section: LaneSection, end: float) -> LaneSection:
    lanes = tuple(
        replace(lane, width=_grown(road, lane.width, section.s, end)) for lane in section.lanes
    )
    return replace(section, lanes=lanes)


def _grown(road: ModelRoad, width: Profile, start: float, end: float) -> Profile:
    if width.is_zero:
        return width
    ds = np.linspace(0.0, end - start, max(2, int(np.ceil(end - start)) + 1))
    # A profile may bend sharply at its knots, which are kept as stations.
    ds = np.unique(np.concatenate([ds, width.start[width.start < end - start]]))
    value = width.at(ds) / np.cos(road.bank.at(start + ds))
    # Tapers stay smooth: the slopes at both ends are those of the profile.
    ends = width.slope(ds[[0, -1]]) / np.cos(road.bank.at(start + ds[[0, -1]]))
    return fitted(ds, value, tolerance=NOTICED_M / 8, slopes=(float(ends[0]), float(ends[1])))
