"""Layout of windows and doors in the walls of a site's buildings that are seen from streets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry

from urbantwin.geometry.rays import RayScene
from urbantwin.scene.facade.style import Door, Style, style_of
from urbantwin.scene.facade.wall import DOOR, GLASS, Front, Opening, Wall
from urbantwin.scene.solids import GroundHeight

__all__ = ["facade_openings"]

#: Beyond this range a window's reveal is smaller than a LiDAR's footprint and noise, metres.
REACH_M = 80.0
#: Directions of rays from a wall, degrees from its normal.
LOOKS_DEG = (-60, -40, -20, 0, 20, 40, 60)
#: Distance of the start of rays in front of their wall, metres.
AHEAD_M = 0.05


def seen_from(
    points: NDArray[np.float64],
    outward: NDArray[np.float64],
    plans: Sequence[Geometry],
    carriageway: Geometry,
) -> NDArray[np.float64]:
    """Return the distance (N,) of the nearest carriageway visible from walls, metres.

    The distance is infinite if no carriageway is visible. Rays are horizontal; footprints block
    them.

    Args:
        points: (N, 2) on walls, site frame.
        outward: (N, 2) unit vectors.
        plans: footprints of buildings.
        carriageway: the carriageways.
    """
    if carriageway.is_empty or not len(points):
        return np.full(len(points), np.inf)
    footprints = _screens(shapely.boundary(np.array(plans, dtype=object)))
    roads = _screens([carriageway.boundary])
    corners = np.concatenate([footprints, roads]).reshape(-1, 3)
    scene = RayScene(corners, np.arange(len(corners)).reshape(-1, 3))
    turn = np.radians(LOOKS_DEG)
    x = outward[:, :1] * np.cos(turn) - outward[:, 1:] * np.sin(turn)
    y = outward[:, :1] * np.sin(turn) + outward[:, 1:] * np.cos(turn)
    rays = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
    start = np.zeros_like(rays)
    start[..., :2] = (points + outward * AHEAD_M)[:, None]
    hits = scene.cast_single(start.reshape(-1, 3), rays.reshape(-1, 3))
    is_road = hits.face >= len(footprints)
    distance = np.where(is_road & (hits.range_m <= REACH_M), hits.range_m, np.inf)
    return np.asarray(distance.reshape(len(points), -1).min(axis=1), np.float64)


def _screens(lines: Sequence[Geometry] | NDArray[np.object_]) -> NDArray[np.float64]:
    """Return upright triangles (F, 3, 3) along lines."""
    parts = shapely.get_parts(shapely.get_parts(lines))
    xy, owner = shapely.get_coordinates(parts, return_index=True)
    follows = owner[1:] == owner[:-1]
    a, b = xy[:-1][follows], xy[1:][follows]
    low, high = np.full((len(a), 1), -1.0), np.full((len(a), 1), 1.0)
    a0, a1, b0, b1 = (np.hstack(pair) for pair in ((a, low), (a, high), (b, low), (b, high)))
    return np.concatenate([np.stack([a0, b0, b1], axis=1), np.stack([a0, b1, a1], axis=1)])


#: Maximum number of windows in a scene: the nearest facades have windows. About 16 triangles each.
MOST_WINDOWS = 40_000
#: Walls narrower or lower than this, metres, have no openings.
NARROWEST_M, LOWEST_M = 1.4, 2.2
#: Minimum width of wall beside, above and below an opening, metres.
PIER_M, LINTEL_M, PLINTH_M = 0.25, 0.2, 0.3
#: A shop mapped as a node within this distance of a wall gives it a shop front, metres.
SHOP_REACH_M = 8.0
#: Maximum distance of mapped entrances from their wall, metres.
ON_WALL_M = 0.6
#: Objects closer than this in front of a wall hide it, metres.
HIDDEN_M = 0.4
SEED = 20_417


@dataclass(frozen=True, eq=False)
class _Facade:
    """A visible wall: its style, and the ground along it."""

    wall: Wall
    style: Style
    datum: float
    ground: tuple[float, float]
    is_shop: bool

    def ground_at(self, s: float) -> float:
        left, right = self.ground
        return left + (right - left) * s / self.wall.length

    def room_at(self, start: float, end: float) -> tuple[float, float]:
        """Return between which heights the wall is whole from ``start`` to ``end``."""
        share = np.array([start, end]) / self.wall.length
        low = self.wall.left[0] + (self.wall.right[0] - self.wall.left[0]) * share
        high = self.wall.left[-1] + (self.wall.right[-1] - self.wall.left[-1]) * share
        return float(low.max()), float(high.min())


def facade_openings(
    fronts: Sequence[Front],
    doors: Sequence[Door],
    shops: NDArray[np.object_],
    carriageway: Geometry,
    *,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> list[list[list[Opening]]]:
    """Return the openings of every wall of every building.

    Only walls from which a carriageway is visible have openings; if there are too many, the nearest
    walls have them.

    Args:
        fronts: the buildings.
        doors: doors of the map.
        shops: points of shops that are mapped as nodes.
        carriageway: the carriageways at ground level, site frame.
        ground_height: heights of the ground.
        notes: counter of windows and doors.
    """
    found: list[list[list[Opening]]] = [[[] for _ in front.walls] for front in fronts]
    rows = [
        (f, w)
        for f, front in enumerate(fronts)
        for w, wall in enumerate(front.walls)
        if wall.length >= NARROWEST_M and _height(wall) >= LOWEST_M
    ]
    if not rows:
        return found
    walls = [fronts[f].walls[w] for f, w in rows]
    start = np.array([wall.start_xy for wall in walls])
    end = np.array([wall.end_xy for wall in walls])
    ahead = (end - start) / np.hypot(*(end - start).T)[:, None]
    outward = np.column_stack([ahead[:, 1], -ahead[:, 0]])
    distance = _distances(fronts, rows, start, end, outward, carriageway)
    seen = np.flatnonzero(np.isfinite(distance))
    if not len(seen):
        return found
    # Slightly in front of the wall, where the ground is outside the building.
    before = outward[seen] * 0.3
    ground = ground_height(np.concatenate([start[seen] + before, end[seen] + before]))
    ground = ground.reshape(2, -1).T
    middle = shapely.points((start[seen] + end[seen]) / 2)
    near_shop = np.zeros(len(seen), bool)
    if len(shops):
        near_shop = (
            shapely.STRtree(shops).query_nearest(middle, return_distance=True, all_matches=False)[1]
            <= SHOP_REACH_M
        )
    styles: dict[int, list[Style | None]] = {}
    facades: dict[tuple[int, int], _Facade] = {}
    for n, k in enumerate(seen.tolist()):
        f, w = rows[k]
        front, wall = fronts[f], walls[k]
        if f not in styles:
            styles[f] = _styles(front)
        style = styles[f][wall.body]
        if style is None:
            continue
        level = (float(ground[n, 0]), float(ground[n, 1]))
        level = tuple(front.datum if np.isnan(z) else z for z in level)  # type: ignore[assignment]
        facades[f, w] = _Facade(wall, style, front.datum, level, bool(near_shop[n]))
    order = {rows[k]: float(distance[k]) for k in seen.tolist()}
    nearest = sorted(facades, key=lambda row: (round(order[row], 1), row))
    _add_doors(found, fronts, facades, nearest, doors, notes)
    _add_windows(found, facades, nearest, notes)
    _drop_hidden(found, fronts, facades)
    panes = [o.kind for row in facades for o in found[row[0]][row[1]]]
    notes["windows"] = sum(kind == GLASS for kind in panes)
    notes["doors"] = sum(kind == DOOR for kind in panes)
    return found


def _height(wall: Wall) -> float:
    return max(wall.left[-1] - wall.left[0], wall.right[-1] - wall.right[0])


def _styles(front: Front) -> list[Style | None]:
    rng = np.random.default_rng([SEED, abs(front.building.id)])
    seen: dict[int, Style | None] = {}
    styles = []
    for volume in front.volumes:
        if id(volume) not in seen:
            seen[id(volume)] = style_of(volume, front.building.tags, rng)
        styles.append(seen[id(volume)])
    return styles


def _distances(
    fronts: Sequence[Front],
    rows: Sequence[tuple[int, int]],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    outward: NDArray[np.float64],
    carriageway: Geometry,
) -> NDArray[np.float64]:
    """Return the distance of the carriageway visible from each wall.

    A wall within its own building's plan is above a lower part of the building, which does not
    block it.
    """
    outer = np.array([fronts[f].walls[w].outer for f, w in rows])
    plans = [front.plan for front in fronts]
    distance = np.full(len(rows), np.inf)
    for share in (0.2, 0.5, 0.8):
        points = start + (end - start) * share
        distance[outer] = np.minimum(
            distance[outer], seen_from(points[outer], outward[outer], plans, carriageway)
        )
        distance[~outer] = np.minimum(
            distance[~outer], seen_from(points[~outer], outward[~outer], [], carriageway)
        )
    return distance


def _add_windows(
    found: list[list[list[Opening]]],
    facades: dict[tuple[int, int], _Facade],
    nearest: Sequence[tuple[int, int]],
    notes: Counter[str],
) -> None:
    count = 0
    for row in nearest:
        holes = found[row[0]][row[1]]
        doors = list(holes)
        for window in _windows(facades[row]):
            clear = all(
                window.start > door.end + PIER_M
                or window.end < door.start - PIER_M
                or window.low > door.high + LINTEL_M
                or window.high < door.low - LINTEL_M
                for door in doors
            )
            if clear:
                holes.append(window)
                count += 1
        if count > MOST_WINDOWS:
            notes["facades without windows: too many"] = len(nearest) - nearest.index(row) - 1
            break


def _windows(facade: _Facade) -> Iterator[Opening]:
    """Yield a wall's windows, storey by storey."""
    style, wall = facade.style, facade.wall
    for number, floor in enumerate(style.storeys):
        width, height, sill, spacing = style.width, style.height, style.sill, style.spacing
        kind, ground = GLASS, style.ground
        if number == 0 and floor == 0 and facade.is_shop and ground == "windows":
            ground = "shop"
        if number == 0 and ground == "shop":
            top = style.storeys[1] if len(style.storeys) > 1 else 3.6
            sill, spacing = 0.45, 3.4
            height = min(top - sill - 0.6, 2.6)
            width = wall.length / max(1, int(wall.length / spacing)) - 0.6
        elif number == 0 and ground == "garage":
            width, height, sill, kind = 2.4, 2.05, 0.0, DOOR
        elif number == 0 and ground == "nothing":
            continue
        if width < 0.5 or height < 0.5:
            continue
        count = int((wall.length - 2 * PIER_M) / max(spacing, width + 2 * PIER_M))
        if count == 0 and wall.length >= width + 4 * PIER_M:
            count = 1
        pitch = wall.length / max(count, 1)
        low = facade.datum + floor + sill
        for k in range(count):
            start = (k + 0.5) * pitch - width / 2
            base = low
            if kind == DOOR:
                base = facade.ground_at(start + width / 2) + 0.02
            bottom, top = facade.room_at(start, start + width)
            soil = max(facade.ground_at(start), facade.ground_at(start + width))
            buried = kind == GLASS and base < soil + PLINTH_M
            if buried or base < bottom + 0.05 or base + height > top - LINTEL_M:
                continue
            yield Opening(start, start + width, base, base + height, style.depth, kind)


def _add_doors(
    found: list[list[list[Opening]]],
    fronts: Sequence[Front],
    facades: dict[tuple[int, int], _Facade],
    nearest: Sequence[tuple[int, int]],
    doors: Sequence[Door],
    notes: Counter[str],
) -> None:
    """Place the map's doors; add a door to the nearest wall of buildings without a door."""
    with_door: set[int] = set()
    rows = list(facades)
    if doors and rows:
        lines = shapely.linestrings(
            [[facades[row].wall.start_xy, facades[row].wall.end_xy] for row in rows]
        )
        for door in doors:
            apart = shapely.distance(lines, door.place)
            for k in np.argsort(apart, kind="stable")[:4].tolist():
                if apart[k] > ON_WALL_M:
                    break
                place = float(shapely.line_locate_point(lines[k], door.place))
                if _hang(found, rows[k], facades[rows[k]], place, door):
                    with_door.add(rows[k][0])
                    notes["doors of the map"] += 1
                    break
    for row in nearest:
        facade = facades[row]
        if row[0] in with_door or facade.style.ground == "garage":
            continue
        if not facade.style.storeys or facade.style.storeys[0] > 0:
            continue
        rng = np.random.default_rng([SEED, abs(fronts[row[0]].building.id), 1])
        columns = max(1, int(facade.wall.length / max(facade.style.spacing, 2.0)))
        column = int(rng.integers(columns))
        place = (column + 0.5) * facade.wall.length / columns
        is_shop = facade.is_shop or facade.style.ground == "shop"
        size = (1.6, 2.3, GLASS) if is_shop else (1.1, 2.1, DOOR)
        if _hang(found, row, facade, place, Door(shapely.Point(), *size)):
            with_door.add(row[0])


def _hang(
    found: list[list[list[Opening]]],
    row: tuple[int, int],
    facade: _Facade,
    place: float,
    door: Door,
) -> bool:
    """Add a door to a wall if there is space for it."""
    half = door.width / 2
    if facade.wall.length < door.width + 2 * PIER_M:
        return False
    place = min(max(place, half + PIER_M), facade.wall.length - half - PIER_M)
    low = facade.ground_at(place) + 0.02
    bottom, top = facade.room_at(place - half, place + half)
    if low < bottom + 0.05 or low + door.height > top - 0.1:
        return False
    holes = found[row[0]][row[1]]
    if any(place - half < o.end + PIER_M and place + half > o.start - PIER_M for o in holes):
        return False
    depth = min(facade.style.depth + 0.03, 0.15)
    holes.append(Opening(place - half, place + half, low, low + door.height, depth, door.kind))
    return True


def _drop_hidden(
    found: list[list[list[Opening]]],
    fronts: Sequence[Front],
    facades: dict[tuple[int, int], _Facade],
) -> None:
    """Remove the openings hidden by a neighbouring building."""
    rows = [row for row in facades if found[row[0]][row[1]] and facades[row].wall.outer]
    if not rows:
        return
    owner = np.concatenate([np.full(len(found[f][w]), n) for n, (f, w) in enumerate(rows)])
    middle = np.concatenate([[(o.start + o.end) / 2 for o in found[f][w]] for f, w in rows])
    start = np.array([facades[row].wall.start_xy for row in rows])
    end = np.array([facades[row].wall.end_xy for row in rows])
    ahead = (end - start) / np.hypot(*(end - start).T)[:, None]
    outward = np.column_stack([ahead[:, 1], -ahead[:, 0]])
    spots = start[owner] + ahead[owner] * middle[:, None] + outward[owner] * HIDDEN_M
    tree = shapely.STRtree([front.plan for front in fronts])
    hidden = np.zeros(len(spots), bool)
    hidden[tree.query(shapely.points(spots), predicate="intersects")[0]] = True
    first = 0
    for f, w in rows:
        holes = found[f][w]
        keep = ~hidden[first : first + len(holes)]
        first += len(holes)
        found[f][w] = [o for o, stays in zip(holes, keep.tolist(), strict=True) if stays]
