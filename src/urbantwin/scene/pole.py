"""Poles: street lamps, utility poles, traffic signs, bus stops, bollards."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from shapely import Geometry, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.placement import beside_carriageway, grounded, toward_carriageway
from urbantwin.scene.solids import Assembly, GroundHeight, box, columns, rods
from urbantwin.scene.tag import length_m_of, yaw_of_direction
from urbantwin.site.extract import OsmFeature

__all__ = ["bollards", "pole_mesh"]

#: Poles stand this far from carriageways and reach this far into the ground, metres.
KERB_M = 0.4
BURIED_M = 0.3
#: A pole mapped within a carriageway is moved to its side if that is nearer than this, metres.
FARTHEST_M = 8.0
#: Lamps farther than this from any carriageway light a path: no arm, and a lower pole.
ARM_REACH_M = 15.0

HUNG = "lamps hung or on walls, not drawn"
HUNG_LAMPS = ("wall", "wall_mounted", "suspended", "ceiling", "ground", "catenary", "bollard")


def pole_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build what stands on poles, traffic signals apart (``signal_pole``).

    Plates are class ``traffic-sign``, all else ``pole``.

    Args:
        features: the map's features, site frame.
        region: objects outside it are left out.
        ground_height: heights of the ground.
        carriageway: where no pole may stand; lamps reach toward it.

    Returns:
        The mesh, ``part`` 1, 2, ... per pole, and counts of what was built or left out.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    kinds: dict[str, list[OsmFeature]] = {name: [] for name in _KINDS}
    for feature in features:
        name = _kind(feature.tags)
        if name is None or not isinstance(feature.geometry, Point):
            continue
        if name == HUNG:
            notes[name] += 1
        elif region.covers(feature.geometry):
            kinds[name].append(feature)
    for name, found in kinds.items():
        if not found:
            continue
        mapped = np.array([[f.geometry.x, f.geometry.y] for f in found])
        # A bollard within a carriageway bars it: roads are drivable, so it is left out.
        reach = 0.0 if name == "bollards" else FARTHEST_M
        xy = beside_carriageway(mapped, carriageway, margin_m=KERB_M, farthest_m=reach)
        keep = np.isfinite(xy[:, 0])
        notes["poles moved off carriageways"] += int((keep & (xy != mapped).any(axis=1)).sum())
        notes["poles on carriageways, left out"] += int((~keep).sum())
        if not keep.any():
            continue
        feet = grounded(xy[keep], ground_height(xy[keep]))
        tags = [f.tags for f, kept in zip(found, keep, strict=True) if kept]
        _KINDS[name](assembly, feet, tags, toward_carriageway(
            feet[:, :2], carriageway, farthest_m=ARM_REACH_M
        ))  # fmt: skip
        notes[name] += len(feet)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def bollards(assembly: Assembly, feet: NDArray[np.float64], heights: NDArray[np.float64]) -> None:
    """Add bollards (N,) on (N, 3) points of the ground."""
    parts = np.repeat([assembly.new_part() for _ in feet], 2 * 8 + 2 * 6)
    solid = columns(feet - [0, 0, BURIED_M], heights + BURIED_M, 0.08, 0.07)
    assembly.add(solid, "pole", "metal-painted", parts)


def _kind(tags: dict[str, str]) -> str | None:
    """Return the name of what a node's tags say stands there."""
    highway, man_made = tags.get("highway"), tags.get("man_made")
    mounts = {tags.get(k) for k in ("lamp_mount", "support", "light:mount")}
    tests = {
        HUNG: highway == "street_lamp" and bool(mounts & set(HUNG_LAMPS)),
        "street lamps": highway == "street_lamp",
        "bus stops": highway == "bus_stop",
        "bollards": tags.get("barrier") == "bollard",
        "utility poles": tags.get("power") == "pole"
        or man_made in ("utility_pole", "telecommunication_pole"),
        "traffic signs": tags.get("traffic_sign", "no") != "no" and highway != "traffic_signals",
        "other poles": man_made in ("pole", "flagpole", "mast")
        or tags.get("power") == "catenary_mast",
    }
    return next((name for name, holds in tests.items() if holds), None)


def _heights(
    tags: Sequence[dict[str, str]], default: float, low: float, high: float
) -> NDArray[np.float64]:
    """Return mapped heights, kept within what such a pole can have."""
    mapped = [length_m_of(t.get("height")) or default for t in tags]
    return np.asarray(np.clip(mapped, low, high), np.float64)


def _add_lamps(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    road: NDArray[np.float64],
) -> None:
    for foot, own, yaw in zip(feet, tags, road, strict=True):
        with_arm = bool(np.isfinite(yaw))
        height = _heights([own], 7.0 if with_arm else 4.5, 2.0, 30.0)[0]
        part = assembly.new_part()
        pole = columns(foot - [0, 0, BURIED_M], height + BURIED_M - 0.05, 0.08, 0.05)
        assembly.add(pole, "pole", "metal-painted", part)
        top = foot + [0, 0, height]
        if with_arm:
            ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
            arm = rods([top - [0, 0, 0.09]], [top + 1.3 * ahead - [0, 0, 0.06]], 0.04, 0.03, 6)
            assembly.add(arm, "pole", "metal-painted", part)
            head = box(top + 1.5 * ahead - [0, 0, 0.06], [0.6, 0.25, 0.12], yaw)
        else:
            head = box(top - [0, 0, 0.2], [0.35, 0.35, 0.4])
        assembly.add(head, "pole", "metal-painted", part)


def _add_utility_poles(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    road: NDArray[np.float64],
) -> None:
    heights = _heights(tags, 9.0, 3.0, 30.0)
    for foot, height, yaw in zip(feet, heights, np.nan_to_num(road), strict=True):
        part = assembly.new_part()
        pole = columns(foot - [0, 0, BURIED_M], height + BURIED_M, 0.14, 0.10)
        assembly.add(pole, "pole", "wood", part)
        arm = box(foot + [0, 0, height - 0.5], [1.8, 0.1, 0.12], yaw)
        assembly.add(arm, "pole", "wood", part)


def _add_signs(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    road: NDArray[np.float64],
) -> None:
    """Add signs: a round plate that faces its mapped direction, else along the road beside it."""
    for foot, own, yaw in zip(feet, tags, road, strict=True):
        facing = yaw_of_direction(own.get("direction") or own.get("traffic_sign:direction"))
        if facing is None:
            facing = float(np.nan_to_num(yaw)) + np.pi / 2
        height = _heights([own], 2.6, 1.0, 6.0)[0]
        part = assembly.new_part()
        pole = columns(foot - [0, 0, BURIED_M], height + BURIED_M, 0.035, 0.035)
        assembly.add(pole, "pole", "metal-painted", part)
        ahead = np.array([np.cos(facing), np.sin(facing), 0.0])
        middle = foot + [0, 0, height - 0.3]
        plate = rods([middle + 0.04 * ahead], [middle + 0.06 * ahead], 0.3, 0.3, 12)
        assembly.add(plate, "traffic-sign", "retroreflector", part)


def _add_bus_stops(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    road: NDArray[np.float64],
) -> None:
    for foot, height, yaw in zip(
        feet, _heights(tags, 2.7, 2.0, 5.0), np.nan_to_num(road), strict=True
    ):
        part = assembly.new_part()
        pole = columns(foot - [0, 0, BURIED_M], height + BURIED_M, 0.04, 0.04)
        assembly.add(pole, "pole", "metal-painted", part)
        plate = box(foot + [0, 0, height - 0.3], [0.45, 0.03, 0.6], yaw)
        assembly.add(plate, "traffic-sign", "metal-painted", part)


def _add_bollards(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    _road: NDArray[np.float64],
) -> None:
    bollards(assembly, feet, _heights(tags, 0.9, 0.3, 1.5))


def _add_other_poles(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    _road: NDArray[np.float64],
) -> None:
    for foot, height in zip(feet, _heights(tags, 5.0, 1.0, 40.0), strict=True):
        pole = columns(foot - [0, 0, BURIED_M], height + BURIED_M, 0.07, 0.05)
        assembly.add(pole, "pole", "metal-painted", assembly.new_part())


Adder = Callable[
    [Assembly, NDArray[np.float64], Sequence[dict[str, str]], NDArray[np.float64]], None
]
_KINDS: dict[str, Adder] = {
    "street lamps": _add_lamps,
    "bus stops": _add_bus_stops,
    "bollards": _add_bollards,
    "utility poles": _add_utility_poles,
    "traffic signs": _add_signs,
    "other poles": _add_other_poles,
}
