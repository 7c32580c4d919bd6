"""Gates and openings of barriers, and barriers that are mapped as points."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Point

from urbantwin.scene.barrier import fence
from urbantwin.scene.catalogue import street_objects
from urbantwin.scene.piece import add_pieces
from urbantwin.scene.placement import along_nearest, on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, box, rods
from urbantwin.scene.tag_values import length_m_of
from urbantwin.scene.tree.shrub import bushes
from urbantwin.site.extract import OsmFeature

__all__ = ["Opening", "add_openings", "add_point_barriers", "opening_of"]

#: Barriers open this wide at gates and entrances, metres.
GATE_M, DOOR_M = 3.0, 1.4
GATES = ("gate", "swing_gate", "sliding_gate", "kissing_gate", "hampshire_gate", "bump_gate")
PASSAGES = ("entrance", "stile", "lift_gate", "sally_port", "toll_booth", "turnstile")
BOOM_M = 4.0


@dataclass(frozen=True)
class Opening:
    """A gap in a barrier; ``kind`` as in ``barrier=*``."""

    spot: Point
    kind: str
    width_m: float
    height_m: float


def opening_of(feature: OsmFeature) -> Opening | None:
    """Return the opening that a node of a barrier makes in it."""
    if not isinstance(feature.geometry, Point):
        return None
    tags = feature.tags
    kind = tags.get("barrier", "")
    if kind not in (*GATES, *PASSAGES):
        if tags.get("entrance", "no") == "no":
            return None
        kind = "entrance"
    usual = DOOR_M if kind in ("kissing_gate", "stile", "turnstile") else GATE_M
    width = length_m_of(tags.get("width") or tags.get("maxwidth")) or usual
    height = length_m_of(tags.get("height")) or 1.3
    return Opening(feature.geometry, kind, min(max(width, 0.8), 12.0), min(height, 4.0))


def add_openings(
    assembly: Assembly,
    openings: Sequence[Opening],
    barriers: Sequence[OsmFeature],
    ways: Sequence[Geometry],
    kept: Geometry,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add the leaves of gates, closed, and booms of lift gates, open.

    Gates on carriageways are left out, so that traffic can pass. A gate is parallel to its barrier,
    or perpendicular to the way through it.
    """
    drawn = [o for o in openings if o.kind in (*GATES, "lift_gate")]
    if not drawn:
        return
    xy = np.array([[o.spot.x, o.spot.y] for o in drawn])
    lines = [f.geometry for f in barriers]
    rings = [g.boundary if g.geom_type.endswith("Polygon") else g for g in lines]
    yaw = along_nearest(xy, rings, farthest_m=0.3)
    across = along_nearest(xy, ways, farthest_m=0.5) + np.pi / 2
    yaw = np.nan_to_num(np.where(np.isfinite(yaw), yaw, across))
    free = shapely.contains_xy(kept, xy[:, 0], xy[:, 1])
    for opening, spot, turn, is_free in zip(drawn, xy, yaw, free, strict=True):
        if opening.kind == "lift_gate":
            _add_boom(assembly, opening, spot, float(turn), kept, ground_height, notes)
        elif is_free:
            _add_leaf(assembly, opening, spot, float(turn), ground_height)
            notes["gates"] += 1
        else:
            notes["gates on carriageways, left open"] += 1


def _add_leaf(
    assembly: Assembly,
    opening: Opening,
    spot: np.ndarray,
    yaw: float,
    ground_height: GroundHeight,
) -> None:
    ahead = np.array([np.cos(yaw), np.sin(yaw)]) * opening.width_m / 2
    ends = np.array([spot - 0.97 * ahead, spot + 0.97 * ahead])
    path = on_ground(ends, ground_height(ends))
    high = opening.height_m
    part = assembly.new_part()
    for solid in (
        fence.strip(path, 0.02, high - 0.05, high, closed=False),
        fence.strip(path, 0.02, 0.12, 0.17, closed=False),
        fence.bars(path, 0.14, high - 0.02, closed=False),
        fence.posts(path, high + 0.1, 0.1),
    ):
        assembly.add(solid, "fence", "metal-painted", part)


def _add_boom(
    assembly: Assembly,
    opening: Opening,
    spot: np.ndarray,
    yaw: float,
    kept: Geometry,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add a lift gate beside its way, the boom upright."""
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    sides = spot + np.array([[-1.0], [1.0]]) * ahead * (opening.width_m / 2 + 0.3)
    free = shapely.contains_xy(kept, sides[:, 0], sides[:, 1])
    if not free.any():
        notes["gates on carriageways, left open"] += 1
        return
    foot = on_ground(sides[[int(np.argmax(free))]], ground_height(sides[[int(np.argmax(free))]]))[0]
    part = assembly.new_part()
    assembly.add(box(foot + [0, 0, 0.4], [0.35, 0.3, 1.4], yaw), "fence", "metal-painted", part)
    boom = rods([foot + [0, 0, 1.05]], [foot + [0, 0, 1.05 + BOOM_M]], 0.05, 0.03, 6)
    assembly.add(boom, "fence", "metal-painted", part)
    notes["lift gates"] += 1


BURIED_M = 0.3
#: Kind -> name in the notes.
KINDS = {
    "block": "blocks",
    "jersey_barrier": "blocks",
    "planter": "planters",
    "log": "logs",
    "debris": "boulders",
    "rock": "boulders",
    "stone": "boulders",
    "cycle_barrier": "staggered railings",
    "motorcycle_barrier": "staggered railings",
    "height_restrictor": "height restrictors",
}


def add_point_barriers(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    ways: Sequence[Geometry],
    kept: Geometry,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add barriers that are mapped as points, across the way that they block."""
    found = []
    for feature in features:
        kind = feature.tags.get("barrier") or feature.tags.get("natural", "")
        shape = feature.geometry
        if kind not in KINDS or not isinstance(shape, Point):
            continue
        if kind == "height_restrictor" or kept.covers(shape):
            found.append((kind, feature))
    if not found:
        return
    xy = np.array([[f.geometry.x, f.geometry.y] for _, f in found])
    feet = on_ground(xy, ground_height(xy))
    yaw = np.nan_to_num(along_nearest(xy, ways, farthest_m=1.0)) + np.pi / 2
    objects = street_objects()
    for (kind, feature), foot, turn in zip(found, feet, yaw.tolist(), strict=True):
        if kind == "height_restrictor":
            if not _add_portal(assembly, feature, foot, turn, kept, ground_height):
                continue
        elif kind in ("rock", "stone", "debris"):
            _add_boulder(assembly, feature, foot)
        elif kind in ("cycle_barrier", "motorcycle_barrier"):
            add_pieces(assembly, objects["staggered railings"].pieces({}), foot, turn)
        else:
            name = "planter across a way" if kind == "planter" else kind
            part = add_pieces(assembly, objects[name].pieces(feature.tags), foot, turn)
            if kind == "planter":
                above = foot + [0, 0, _height(feature, 0.6, 2.0) - 0.1]
                plants, _ = bushes(above[None], np.array([0.4]), np.array([0.6]), feature.id)
                assembly.add(plants, "vegetation", "foliage", part)
        notes[KINDS[kind]] += 1


def _height(feature: OsmFeature, usual: float, most: float) -> float:
    return min(length_m_of(feature.tags.get("height")) or usual, most)


def _add_boulder(assembly: Assembly, feature: OsmFeature, foot: NDArray[np.float64]) -> None:
    height = _height(feature, 0.7, 4.0)
    body, _ = bushes(foot[None], np.array([0.8 * height]), np.array([height]), feature.id)
    assembly.add(body, "other-object", "stone", assembly.new_part())


def _add_portal(
    assembly: Assembly,
    feature: OsmFeature,
    foot: NDArray[np.float64],
    yaw: float,
    kept: Geometry,
    ground_height: GroundHeight,
) -> bool:
    """Add a beam over a way, its posts at the first free place to both sides."""
    high = min(length_m_of(feature.tags.get("maxheight")) or 2.2, 6.0)
    way = np.array([np.cos(yaw), np.sin(yaw)])
    steps = np.arange(1.8, 8.0, 0.2)[:, None]
    spots = []
    for side in (1, -1):
        line = foot[:2] + side * steps * way
        free = shapely.contains_xy(kept, line[:, 0], line[:, 1])
        if not free.any():
            return False
        spots.append(line[int(np.argmax(free))])
    ends = on_ground(np.array(spots), ground_height(np.array(spots)))
    top = max(foot[2], *ends[:, 2]) + high + 0.1
    tops = np.column_stack([ends[:, :2], [top, top]])
    part = assembly.new_part()
    down = [0, 0, BURIED_M]
    portal = rods([*(ends - down), tops[0]], [*(tops + [0, 0, 0.08]), tops[1]], 0.06, 0.06, 8)
    assembly.add(portal, "other-structure", "metal-painted", part)
    return True
