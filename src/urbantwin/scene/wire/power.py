"""Power lines: conductors between towers and poles, and the towers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon

from urbantwin.number_text import whole_number
from urbantwin.scene.placement import on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box, columns, rods
from urbantwin.scene.tag_values import count_of, length_m_of
from urbantwin.scene.wire.catenary import catenaries, wire_solid
from urbantwin.site.extract import OsmFeature

__all__ = ["add_power_lines"]

#: Sag over span at everyday temperature: 2 to 4 % on towers, 1 to 2 % on poles.
TOWER_SAG, POLE_SAG = 0.03, 0.015
#: Heights: of poles as in ``pole_mesh``; of towers by voltage (kV), metres.
POLE_M = 9.0
TOWERS_M = ((300, 50.0), (200, 42.0), (100, 30.0), (50, 25.0), (0, 20.0))
BURIED_M = 0.5
SHORTEST_M = 2.0
STEPS = 14
SUPPORTS = ("tower", "pole", "portal", "terminal")


def add_power_lines(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    region: Polygon,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add conductors and towers; mapped poles are drawn by ``pole_mesh``.

    Every node of a line is a support, as in the map's conventions; if its kind is not mapped, a
    pole or a tower is assumed. Conductors have the class ``other-object``.
    """
    nodes = {
        (f.geometry.x, f.geometry.y): f.tags
        for f in features
        if f.tags.get("power") in SUPPORTS and isinstance(f.geometry, Point)
    }
    drawn: set[tuple[float, float]] = set()
    for feature in features:
        tags, line = feature.tags, feature.geometry
        if tags.get("power") not in ("line", "minor_line") or not isinstance(line, LineString):
            continue
        if tags.get("location") in ("underground", "underwater", "indoor"):
            continue
        xy = shapely.get_coordinates(shapely.remove_repeated_points(line, 0.5))
        if len(xy) < 2 or line.length < SHORTEST_M:
            continue
        feet = on_ground(xy, ground_height(xy))
        on_towers = tags["power"] == "line"
        support = [nodes.get((x, y), {}) for x, y in xy.tolist()]
        high = np.array([_height(own, tags, on_towers=on_towers) for own in support])
        across = _across(xy)
        arms = _arms(tags, on_towers=on_towers)
        for place, own, foot, tall, side in zip(
            map(tuple, xy.tolist()), support, feet, high.tolist(), across, strict=True
        ):
            if place in drawn or not region.covers(Point(place)) or own.get("power") == "pole":
                continue
            drawn.add(place)
            _add_support(assembly, own.get("power"), foot, tall, side, arms, on_towers=on_towers)
            notes["power towers" if on_towers else "utility poles"] += 1
            notes["supports of power lines seeded"] += not own
        _add_conductors(assembly, feet, high, across, arms, region, on_towers=on_towers)
        notes["power lines"] += 1


def _height(own: Mapping[str, str], line: Mapping[str, str], *, on_towers: bool) -> float:
    if not on_towers or own.get("power") == "pole":
        return min(max(length_m_of(own.get("height")) or POLE_M, 3.0), 30.0)
    volts = map(whole_number, line.get("voltage", "").split(";"))
    kilovolts = max((v / 1000 for v in volts if v is not None and v >= 0), default=60)
    usual = next(high for least, high in TOWERS_M if kilovolts >= least)
    return min(max(length_m_of(own.get("height")) or usual, 8.0), 120.0)


def _across(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vectors (N, 2) square to a line at its corners."""
    way = np.diff(xy, axis=0)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    both = np.concatenate([way[:1], way[:-1] + way[1:], way[-1:]])
    flat = np.linalg.norm(both, axis=1) < 1e-6
    both[flat] = np.concatenate([way[:1], way])[flat]
    both /= np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-9)
    return np.column_stack([-both[:, 1], both[:, 0]])


def _arms(tags: Mapping[str, str], *, on_towers: bool) -> NDArray[np.float64]:
    """Return the attachments of conductors (K, 2): across, over the height; height share."""
    cables = int(min(count_of(tags.get("cables")) or (6 if on_towers else 3), 12))
    if not on_towers:
        spread = np.linspace(-0.8, 0.8, max(cables, 1)) if cables > 1 else np.zeros(1)
        return np.column_stack([spread / POLE_M, np.full(len(spread), 0.96)])
    if cables <= 3:
        return np.column_stack(
            [np.linspace(-0.2, 0.2, max(cables, 2)), np.full(max(cables, 2), 0.85)]
        )
    levels = [(0.90, 0.11), (0.78, 0.15), (0.66, 0.12)]
    per_side = max(int(np.ceil(cables / 6)), 1)
    spots = [
        (side * reach * (k + 1) / per_side, up)
        for up, reach in levels
        for side in (-1, 1)
        for k in range(per_side)
    ]
    return np.array([*spots, (0.0, 1.0)])


def _hooks(
    feet: NDArray[np.float64],
    high: NDArray[np.float64],
    across: NDArray[np.float64],
    arms: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the attachment points of conductors (K, N, 3)."""
    out = arms[:, None, :1] * high[None, :, None] * across[None]
    up = feet[None, :, 2:] + (arms[:, 1:] * high)[..., None]
    return np.concatenate([feet[None, :, :2] + out, up], axis=2)


def _add_conductors(
    assembly: Assembly,
    feet: NDArray[np.float64],
    high: NDArray[np.float64],
    across: NDArray[np.float64],
    arms: NDArray[np.float64],
    region: Polygon,
    *,
    on_towers: bool,
) -> None:
    hooks = _hooks(feet, high, across, arms)
    starts, ends = hooks[:, :-1].reshape(-1, 3), hooks[:, 1:].reshape(-1, 3)
    span = np.linalg.norm((ends - starts)[:, :2], axis=1)
    keep = span > 1.0
    sag = (TOWER_SAG if on_towers else POLE_SAG) * span
    points = catenaries(starts[keep], ends[keep], sag[keep], STEPS)
    pieces = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3)
    inside = _inside(pieces, region)
    if inside.any():
        assembly.add(wire_solid(pieces[inside]), "other-object", "metal-bare", assembly.new_part())


def _inside(pieces: NDArray[np.float64], region: Polygon) -> NDArray[np.bool_]:
    shapely.prepare(region)
    ends = [shapely.contains_xy(region, pieces[:, k, 0], pieces[:, k, 1]) for k in (0, 1)]
    return np.asarray(ends[0] & ends[1])


def _add_support(
    assembly: Assembly,
    kind: str | None,
    foot: NDArray[np.float64],
    high: float,
    side: NDArray[np.float64],
    arms: NDArray[np.float64],
    *,
    on_towers: bool,
) -> None:
    part = assembly.new_part()
    yaw = float(np.arctan2(side[1], side[0]))
    if not on_towers:
        pole = columns(foot - [0, 0, 0.3], high + 0.3, 0.14, 0.10)
        assembly.add(pole, "pole", "wood", part)
        reach = 2 * float(np.abs(arms[:, 0]).max()) * high + 0.2
        arm = box(foot + [0, 0, 0.95 * high], [max(reach, 0.4), 0.1, 0.12], yaw)
        assembly.add(arm, "pole", "wood", part)
        return
    levels = np.unique(arms[:, 1])
    for level in levels[levels < 1.0].tolist():
        reach = 2 * float(np.abs(arms[arms[:, 1] == level, 0]).max()) * high + 0.4
        beam = box(foot + [0, 0, level * high + 0.3], [reach, 0.35, 0.35], yaw)
        assembly.add(beam, "other-structure", "metal-painted", part)
    if kind == "portal":
        legs = foot + np.array([[-1.0], [1.0]]) * 0.18 * high * np.array([side[0], side[1], 0.0])
        posts = columns(legs - [0, 0, BURIED_M], 0.9 * high + BURIED_M, 0.25, 0.2)
        assembly.add(posts, "other-structure", "metal-painted", part)
        return
    assembly.add(_lattice(foot, high, side), "other-structure", "metal-painted", part)


def _lattice(foot: NDArray[np.float64], high: float, side: NDArray[np.float64]) -> Solid:
    """Return a lattice tower: four legs, braced, wide below and narrow above 0.6 of its height."""
    ahead = np.array([-side[1], side[0]])
    shares = np.array([-BURIED_M / high, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0])
    half = np.interp(shares, [0, 0.6, 1.0], [high / 12, high / 40, high / 80])
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    ring = corners[:, 0, None, None] * side + corners[:, 1, None, None] * ahead
    plan = foot[:2] + ring * half[:, None]
    up = np.broadcast_to(foot[2] + shares * high, (4, len(shares)))[..., None]
    legs = np.concatenate([plan, up], axis=2)
    beside = np.roll(legs, -1, axis=0)
    starts = [legs[:, :-1], legs[:, :-1], beside[:, :-1], legs[:, 1:]]
    ends = [legs[:, 1:], beside[:, 1:], legs[:, 1:], beside[:, 1:]]
    joined = [np.concatenate([p.reshape(-1, 3) for p in side_]) for side_ in (starts, ends)]
    thick = np.repeat([0.09, 0.05, 0.05, 0.05], 4 * (len(shares) - 1))
    return rods(joined[0], joined[1], thick, thick, 4)
