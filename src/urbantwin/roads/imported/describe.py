"""Summary of a road map: format, georeference, size and counts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from urbantwin.geometry import SiteFrame
from urbantwin.roads.imported.read import (
    anchor_of,
    is_placed,
    map_format,
    placed_map,
    read_map,
)
from urbantwin.roads.model import LaneModel
from urbantwin.roads.opendrive.reading.read import read_opendrive

__all__ = ["describe_map"]


def describe_map(path: Path) -> dict[str, object]:
    """Return a map's format, georeference, size and counts, and its reader's remarks.

    Raises:
        InputError: it cannot be read.
    """
    if map_format(path) != "OpenDRIVE":
        place = anchor_of(path) if is_placed(path) else None
        imported = read_map(path, SiteFrame(*(place or (0.0, 0.0))))
        model, notes = imported.model, dict(imported.notes)
        where = "none" if place is None else f"latitude {place[0]:.6f}, longitude {place[1]:.6f}"
    else:
        read = read_opendrive(path)
        # Where it lies matters to none of the counts.
        imported = placed_map(path, read._replace(projection=None), SiteFrame(0.0, 0.0))
        model, notes = read.model, dict(imported.notes)
        where = read.projection or "none"
    return {**notes, "georeference": where, **_counted(model)}


def _counted(model: LaneModel) -> dict[str, object]:
    streets = [road for road in model.roads if road.junction < 0]
    metres: Counter[str] = Counter()
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            for lane in section.lanes:
                metres[lane.kind] += round(end - section.s)
    points = np.vstack([road.curve.at([0.0, road.length])[:, :2] for road in model.roads])
    heights = np.concatenate([road.elevation.at([0.0, road.length]) for road in model.roads])
    return {
        "driving_side": model.driving_side,
        "streets": len(streets),
        "junctions": len(model.junctions),
        "signals": sum(signal.dynamic for signal in model.signals),
        "signs": sum(not signal.dynamic for signal in model.signals),
        "crosswalks": sum(area.kind == "crosswalk" for area in model.areas),
        "metres_of_lanes": dict(metres.most_common()),
        "size_m": [round(float(value), 1) for value in np.ptp(points, axis=0)],
        "lowest_m": round(float(heights.min()), 2),
        "highest_m": round(float(heights.max()), 2),
    }
