"""Poles: street lamps, utility poles, traffic signs, bus stops, bollards."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.lamp import add_lamps, add_wall_lamps, seeded_lamps
from urbantwin.scene.placement import (
    along_nearest,
    beside_carriageway,
    not_imported,
    on_ground,
    toward_carriageway,
)
from urbantwin.scene.sign_plate import add_plates, stack_m
from urbantwin.scene.solids import Assembly, GroundHeight, box, columns
from urbantwin.scene.tag_values import length_m_of, yaw_of_direction
from urbantwin.site.corrections import REMOVED
from urbantwin.site.extract import OsmFeature

__all__ = ["bollards", "pole_mesh"]

#: Poles stand this far from carriageways and reach this far into the ground, metres.
KERB_M = 0.4
BURIED_M = 0.3
#: People pass below plates (VwV-StVO to section 39: 2.0 m above sidewalks).
CLEAR_M = 2.0
#: A pole mapped within a carriageway is moved to its side if that is nearer than this, metres.
FARTHEST_M = 8.0
#: Lamps farther than this from any carriageway light a path: no arm, and a lower pole.
ARM_REACH_M = 15.0

HUNG = "lamps hung or on walls, not drawn"
POWER_LINES = ("line", "minor_line")
HUNG_LAMPS = ("wall", "wall_mounted", "ceiling", "ground", "bollard")
#: Lamps on wires are drawn by ``wire_mesh``.
ON_WIRES = ("suspended", "catenary")


def pole_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    without: Geometry | None = None,
    decks: Geometry | None = None,
    deck_height: GroundHeight | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build poles and what they carry, except traffic signals (``signal_pole``).

    Plates are class ``traffic-sign``, all else ``pole``. Streets with ``lit=yes`` without a lamp
    in the map get seeded ones.

    Args:
        features: the map's features, site frame.
        region: objects outside it are left out.
        ground_height: heights of the ground.
        carriageway: where no pole may stand; lamps reach toward it.
        without: where imported geometry has the poles.
        decks: decks over the ground in plan: mapped lamps and signs stand on them.
        deck_height: heights of decks, else of the ground.

    Returns:
        The mesh, ``part`` 1, 2, ... per pole, and counts of what was built or left out.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    kinds: dict[str, list[OsmFeature]] = {name: [] for name in (*_KINDS, HUNG)}
    for feature in not_imported([f for f in features if _kind(f.tags)], without):
        name = _kind(feature.tags)
        if name and isinstance(feature.geometry, Point) and region.covers(feature.geometry):
            kinds[name].append(feature)
    houses = [
        f.geometry for f in features
        if "building" in f.tags and f.geometry.geom_type.endswith("Polygon")
    ]  # fmt: skip
    hung = kinds.pop(HUNG)
    notes["lamps on walls"] = add_wall_lamps(assembly, hung, houses, ground_height)
    notes[HUNG] = len(hung) - notes["lamps on walls"]
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
        on_decks = name in ("street lamps", "traffic signs")
        height = deck_height if on_decks and deck_height else ground_height
        feet = on_ground(xy[keep], height(xy[keep]))
        tags = [f.tags for f, kept in zip(found, keep, strict=True) if kept]
        first = assembly.parts + 1
        road = toward_carriageway(feet[:, :2], carriageway, farthest_m=ARM_REACH_M)
        if name == "street lamps":
            add_lamps(assembly, feet, tags, carriageway)
        else:
            toward = road
            if name == "utility poles":
                lines = [f.geometry for f in features if f.tags.get("power") in POWER_LINES]
                along = along_nearest(feet[:, :2], lines, farthest_m=2.0)
                toward = np.where(np.isfinite(along), along + np.pi / 2, toward)
            adder = _KINDS[name]
            assert adder is not None
            adder(assembly, feet, tags, toward)
        signs = [k for k, own in enumerate(tags) if _carries_signs(name, own)]
        for k in signs:
            add_plates(assembly, feet[k], tags[k], first + k, _facing(tags[k], road[k]), 2.9, 0.13)
        notes["signs on other poles"] += len(signs)
        notes[name] += len(feet)
    taken = shapely.union_all([h for h in houses if region.intersects(h)])
    for other in (without, decks):
        if other is not None:
            taken = shapely.union(taken, other)
    lamps = seeded_lamps(features, region, carriageway, taken)
    if len(lamps):
        feet = on_ground(lamps, ground_height(lamps))
        add_lamps(assembly, feet, [{}] * len(feet), carriageway)
        notes["street lamps seeded where lit=yes"] = len(lamps)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def bollards(assembly: Assembly, feet: NDArray[np.float64], heights: NDArray[np.float64]) -> None:
    """Add bollards (N,) on (N, 3) points of the ground."""
    parts = np.repeat([assembly.new_part() for _ in feet], 2 * 8 + 2 * 6)
    solid = columns(feet - [0, 0, BURIED_M], heights + BURIED_M, 0.08, 0.07)
    assembly.add(solid, "pole", "metal-painted", parts)


def _kind(tags: dict[str, str]) -> str | None:
    """Return the name of what a node's tags say stands there."""
    if REMOVED in tags:
        return None
    highway, man_made = tags.get("highway"), tags.get("man_made")
    mounts = {tags.get(k) for k in ("lamp_mount", "support", "light:mount")}
    tests = {
        HUNG: highway == "street_lamp" and bool(mounts & set(HUNG_LAMPS)),
        "street lamps": highway == "street_lamp" and not mounts & set(ON_WIRES),
        "bus stops": highway == "bus_stop",
        "bollards": tags.get("barrier") == "bollard",
        "utility poles": tags.get("power") == "pole"
        or man_made in ("utility_pole", "telecommunication_pole"),
        "traffic signs": tags.get("traffic_sign", "no") != "no" and highway != "traffic_signals",
        "other poles": man_made in ("pole", "flagpole", "mast")
        or tags.get("power") == "catenary_mast",
    }
    return next((name for name, holds in tests.items() if holds), None)


def _carries_signs(name: str, tags: dict[str, str]) -> bool:
    return name in ("street lamps", "utility poles") and tags.get("traffic_sign", "no") != "no"


def _facing(tags: dict[str, str], toward: float) -> float:
    """Return where a sign looks: as mapped, else along the road beside it."""
    said = yaw_of_direction(tags.get("traffic_sign:direction") or tags.get("direction"))
    return float(np.nan_to_num(toward)) + np.pi / 2 if said is None else said


def _heights(
    tags: Sequence[dict[str, str]], default: float, low: float, high: float
) -> NDArray[np.float64]:
    """Return mapped heights, kept within what such a pole can have."""
    mapped = [length_m_of(t.get("height")) or default for t in tags]
    return np.asarray(np.clip(mapped, low, high), np.float64)


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
    """Add signs: plates that face their mapped direction, else along the road beside them."""
    for foot, own, yaw in zip(feet, tags, road, strict=True):
        height = _heights([own], max(2.6, CLEAR_M + stack_m(own)), 1.0, 6.0)[0]
        part = assembly.new_part()
        pole = columns(foot - [0, 0, BURIED_M], height + BURIED_M, 0.035, 0.035)
        assembly.add(pole, "pole", "metal-painted", part)
        add_plates(assembly, foot, own, part, _facing(own, float(yaw)), height, 0.05)


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
_KINDS: dict[str, Adder | None] = {
    "street lamps": None,
    "bus stops": _add_bus_stops,
    "bollards": _add_bollards,
    "utility poles": _add_utility_poles,
    "traffic signs": _add_signs,
    "other poles": _add_other_poles,
}
