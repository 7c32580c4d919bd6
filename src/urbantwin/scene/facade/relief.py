"""What stands out of facades: steps, sills, downpipes, balconies, fascias and awnings of shops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry

from urbantwin.scene.facade.front import Front
from urbantwin.scene.facade.wall import Opening, Wall
from urbantwin.scene.face import DOOR, GLASS
from urbantwin.scene.solids import GroundHeight, Solid, box, rods

__all__ = ["Relief", "facade_relief"]

#: Steps before doors: rise and going (DIN 18065: 14 to 20 and 23 to 37 cm), at most so many.
RISE_M, GOING_M, MOST_STEPS = 0.165, 0.29, 3
#: Sills stand out by so much; only of windows that low above the ground, and not of more.
SILL_M, SILLS_BELOW_M, MOST_SILLS = 0.06, 5.0, 1_500
#: Downpipes of DN 100, one at the end of a wall of this length (EN 12056-3 sets what they carry).
PIPE_M, PIPED_WALL_M = 0.05, 6.0
#: Balconies: depth and width, slab, parapet (building codes: 0.9 to 1.1 m), height of the lowest.
DEEP_M, WIDE_M, SLAB_M, PARAPET_M, LOWEST_M, MOST_BALCONIES = 1.3, 2.8, 0.16, 1.0, 2.5, 400
#: Floors are so far below the sills of their windows, metres.
BREAST_M = 0.85
#: Share of houses of three storeys and more that have them on the street; an estimate.
WITH_BALCONIES = 0.3
#: Fascias over shop windows, and awnings over a share of them; clear height below.
FASCIA_M, FASCIA_DEEP_M, AWNINGS, AWNING_M, CLEAR_M = 0.5, 0.14, 0.35, 1.1, 2.4
#: Windows that begin this low and are this large are those of shops.
SHOP_SILL_M, SHOP_M = 0.8, 1.6
SEED = 31_007

#: A solid and its material.
Part = tuple[Solid, str]


@dataclass(frozen=True, eq=False)
class Relief:
    """The openings of every wall of every building, doors raised, and parts per building."""

    openings: list[list[list[Opening]]]
    parts: list[list[Part]]


@dataclass(frozen=True, eq=False)
class _Room:
    """Where there is room beside buildings."""

    plans: shapely.STRtree
    street: Geometry

    def is_free(self, area: shapely.Polygon, own: int, *, on_street: bool) -> bool:
        """Return whether no neighbour is in an area, nor, if asked, the street."""
        inside = self.plans.query(area, predicate="intersects").tolist()
        if any(k != own for k in inside):
            return False
        return on_street or not shapely.intersects(self.street, area)


@dataclass(frozen=True, eq=False)
class _Place:
    """A wall's frame: from along it, out of it and up to the site's."""

    start: NDArray[np.float64]
    ahead: NDArray[np.float64]
    yaw: float

    @classmethod
    def of(cls, wall: Wall) -> _Place:
        start, end = np.array(wall.start_xy), np.array(wall.end_xy)
        ahead = (end - start) / wall.length
        return cls(start, ahead, float(np.arctan2(ahead[1], ahead[0])))

    def at(self, along: float, out: float, up: float) -> NDArray[np.float64]:
        outward = np.array([self.ahead[1], -self.ahead[0]])
        return np.array([*(self.start + along * self.ahead + out * outward), up])

    def box(
        self, along: float, out: tuple[float, float], up: tuple[float, float], wide: float
    ) -> Solid:
        """Return a box about a place along the wall, between two distances and two heights."""
        centre = self.at(along, sum(out) / 2, sum(up) / 2)
        return box(centre, [wide, out[1] - out[0], up[1] - up[0]], self.yaw)

    def area(self, along: float, deep: float, wide: float) -> shapely.Polygon:
        corners = [(-wide / 2, 0.05), (wide / 2, 0.05), (wide / 2, deep), (-wide / 2, deep)]
        return shapely.Polygon([self.at(along + s, out, 0.0)[:2] for s, out in corners])


def facade_relief(
    fronts: Sequence[Front],
    openings: Sequence[Sequence[Sequence[Opening]]],
    street: Geometry,
    *,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> Relief:
    """Return what stands out of the walls that have windows or doors.

    Nothing that people walk into stands on the street, and nothing stands in a neighbour.

    Args:
        fronts: the buildings.
        openings: of each wall of each building.
        street: carriageways and footways, site frame.
        ground_height: heights of the ground.
        notes: counter of what was built.
    """
    room = _Room(shapely.STRtree([front.plan for front in fronts]), street)
    shapely.prepare(street)
    found = [[list(holes) for holes in walls] for walls in openings]
    parts: list[list[Part]] = [[] for _ in fronts]
    counts: Counter[str] = Counter()
    for number, front in enumerate(fronts):
        draws = np.random.default_rng([SEED, abs(front.building.id)]).random(4)
        for wall, holes in zip(front.walls, found[number], strict=True):
            if not holes or not wall.outer:
                continue
            place = _Place.of(wall)
            before = np.array([place.at(s, 0.4, 0.0)[:2] for s in (0.2, wall.length - 0.2)])
            level = np.where(np.isnan(z := ground_height(before)), front.datum, z)
            one = _Facade(place, wall, holes, level, number, room, draws)
            for name, built in (
                ("entrance steps", one.steps()),
                ("fascias", one.fascias()),
                ("awnings", one.awnings()),
                ("sills", one.sills() if counts["sills"] < MOST_SILLS else ()),
                ("balconies", one.balconies() if _has_balconies(front, draws[0])
                 and counts["balconies"] < MOST_BALCONIES else ()),
                ("downpipes", one.downpipes()),
            ):  # fmt: skip
                for what in built:
                    parts[number] += what
                    counts[name] += 1
    notes.update(counts)
    return Relief(found, parts)


def _has_balconies(front: Front, draw: float) -> bool:
    """Return whether balconies are drawn on a building that has none mapped."""
    storeys = max((v.eaves_m / v.storey_m for v in front.volumes), default=0.0)
    return storeys >= 2.8 and draw < WITH_BALCONIES and not front.building.balconies


@dataclass(frozen=True, eq=False)
class _Facade:
    """One wall: its openings, the ground (2,) at its ends, and its building's draws."""

    place: _Place
    wall: Wall
    holes: list[Opening]
    level: NDArray[np.float64]
    own: int
    room: _Room
    draws: NDArray[np.float64]

    @property
    def low(self) -> float:
        return float(self.level.min())

    @property
    def top(self) -> float:
        return min(self.wall.left[-1], self.wall.right[-1]) - 0.1

    def _panes(self) -> Iterator[tuple[Opening, float, float, bool]]:
        """Yield windows, their middle and width, and whether they are a shop's."""
        for hole in self.holes:
            if hole.kind == GLASS:
                is_shop = hole.low - self.low < SHOP_SILL_M and hole.high - hole.low > SHOP_M
                yield hole, (hole.start + hole.end) / 2, hole.end - hole.start, is_shop

    def steps(self) -> Iterator[list[Part]]:
        """Raise doors where there is room before them, and yield the steps up to each."""
        wanted = int(1 + self.draws[1] * MOST_STEPS)
        for k, door in enumerate(self.holes):
            middle, wide = (door.start + door.end) / 2, door.end - door.start
            steps = self._raised_by(k, wanted) if door.kind == DOOR and wide < 1.6 else 0
            area = self.place.area(middle, GOING_M * steps + 0.1, wide + 0.4)
            if not steps or not self.room.is_free(area, self.own, on_street=False):
                continue
            up = steps * RISE_M
            self.holes[k] = replace(door, low=door.low + up, high=door.high + up)
            yield [
                (
                    self.place.box(
                        middle,
                        (-0.02, GOING_M * (steps - n)),
                        (door.low - 0.3, door.low + RISE_M * (n + 1)),
                        wide + 0.4,
                    ),
                    "stone",
                )
                for n in range(steps)
            ]

    def _raised_by(self, k: int, wanted: int) -> int:
        """Return by how many steps a door can be raised: none, where something is above it."""
        door = self.holes[k]
        beside = [h for n, h in enumerate(self.holes)
                  if n != k and h.start < door.end + 0.1 and h.end > door.start - 0.1]  # fmt: skip
        for steps in range(wanted, 0, -1):
            top = door.high + steps * RISE_M
            if top < self.top and all(h.low > top + 0.2 for h in beside):
                return steps
        return 0

    def fascias(self) -> Iterator[list[Part]]:
        """Yield the boards over shop windows."""
        for hole, middle, wide, is_shop in self._panes():
            top = hole.high + 0.1 + FASCIA_M
            if is_shop and top < self.top:
                up = (top - FASCIA_M, top)
                yield [(self.place.box(middle, (-0.02, FASCIA_DEEP_M), up, wide + 0.3), "plastic")]

    def awnings(self) -> Iterator[list[Part]]:
        """Yield the cloths over shop windows."""
        for hole, middle, wide, is_shop in self._panes():
            area = self.place.area(middle, AWNING_M, wide)
            shaded = is_shop and self.draws[2] < AWNINGS and hole.high - self.low > CLEAR_M
            if shaded and self.room.is_free(area, self.own, on_street=True):
                up = (hole.high + 0.03, hole.high + 0.08)
                yield [(self.place.box(middle, (0.0, AWNING_M), up, wide), "cloth")]

    def sills(self) -> Iterator[list[Part]]:
        """Yield the sills of windows near the ground."""
        for hole, middle, wide, is_shop in self._panes():
            if not is_shop and hole.low - self.low < SILLS_BELOW_M:
                up = (hole.low - 0.05, hole.low - 0.01)
                yield [(self.place.box(middle, (-0.02, SILL_M), up, wide + 0.1), "stone")]

    def balconies(self) -> Iterator[list[Part]]:
        """Yield balconies before every third column of windows, above the ground floor."""
        upper = [p for p in self._panes() if p[0].low - BREAST_M - self.low > LOWEST_M]
        columns = sorted({round(hole.start, 1) for hole, *_ in upper})
        chosen = columns[int(self.draws[3] * 3) :: 3] if len(columns) > 1 else []
        for hole, middle, _, _ in upper:
            area = self.place.area(middle, DEEP_M, WIDE_M)
            if round(hole.start, 1) not in chosen:
                continue
            if self.room.is_free(area, self.own, on_street=True):
                floor = hole.low - BREAST_M
                rail = (floor, floor + PARAPET_M)
                front = self.place.box(middle, (DEEP_M - 0.06, DEEP_M), rail, WIDE_M - 0.12)
                ends = [
                    self.place.box(middle + side * (WIDE_M / 2 - 0.03), (0.0, DEEP_M), rail, 0.06)
                    for side in (1, -1)
                ]
                slab = self.place.box(middle, (-0.02, DEEP_M), (floor - SLAB_M, floor), WIDE_M)
                sides = [(one, "metal-painted") for one in (front, *ends)]
                yield [(slab, "concrete"), *sides]

    def downpipes(self) -> Iterator[list[Part]]:
        """Yield a downpipe at the end of a long wall."""
        along, top = self.wall.length - 0.3, self.wall.right[-1] - 0.05
        low = float(self.level[1]) - 0.1
        room = all(hole.end < along - 0.1 for hole in self.holes)
        if self.wall.length >= PIPED_WALL_M and room and top > low + 2.0:
            foot, head = (self.place.at(along, 0.08, z) for z in (low, top))
            yield [(rods(foot, head, PIPE_M, PIPE_M, 6), "metal-painted")]
