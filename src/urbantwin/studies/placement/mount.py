"""Mounts: candidate places of sensors on a twin, with heights."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import DownwardProbe
from urbantwin.lidar.enclosure import enclosing
from urbantwin.lidar.sight.junction import Junction
from urbantwin.studies.placement.mount_places import (
    facade_places,
    mapped_poles,
    new_pole_places,
)
from urbantwin.studies.placement.place_file import MountKind, OwnPlace, PlaceSpec
from urbantwin.twin import Twin

__all__ = ["BRACKET_M", "Mount", "Mounts", "find_mounts"]

#: Distance of a sensor from the axis of a pole or from a wall, metres.
BRACKET_M = 0.5
#: Lowest top of a usable pole or mast, out of reach of vans and hands, metres.
_LOWEST_M = 2.8
#: Height of a sensor above the top of a pole, metres.
_ON_TOP_M = 0.3
#: Margin around objects in plan within which they are tested for enclosing a place, metres.
_NEAR_M = 0.1
#: Smallest visible fraction of lanes and crossings for a candidate.
_BLIND = 0.02


@dataclass(frozen=True)
class Mount:
    """A candidate place of sensors, one at each height.

    Attributes:
        name: unique name.
        kind: kind of support.
        east_m: position of the sensor, metres east of the anchor.
        north_m: metres north of the anchor.
        ground_m: z of the ground there, site frame.
        heights_m: heights above the ground.
        toward: heading to the centre of the junction, radians.
    """

    name: str
    kind: MountKind
    east_m: float
    north_m: float
    ground_m: float
    heights_m: tuple[float, ...]
    toward: float

    def place(self, height_m: float) -> NDArray[np.float64]:
        """Return the position (3,) of a sensor, site frame."""
        return np.array([self.east_m, self.north_m, self.ground_m + height_m])


@dataclass(frozen=True)
class Mounts:
    """All mounts of a search.

    Attributes:
        every: the mounts, the user's own first.
        left_out: number of rejected places, by reason.
    """

    every: tuple[Mount, ...]
    left_out: dict[str, int]


def find_mounts(
    spec: PlaceSpec, twin: Twin, junction: Junction, file: Path | None = None
) -> Mounts:
    """Find candidate places of sensors.

    Args:
        spec: the requested placement.
        twin: the twin.
        junction: junction to cover.
        file: ``place.yaml``, for errors.

    Raises:
        InputError: a place given by the user is outside the ground or inside an object, or there is
            no candidate.
    """
    finder = _Finder(spec, twin, junction, file)
    own = [finder.own(number, one) for number, one in enumerate(spec.candidates.places)]
    found = [mount for kind in dict.fromkeys(spec.candidates.kinds) for mount in finder.of(kind)]
    if not own and not found:
        raise InputError(
            "there is no place where a sensor may hang"
            + (f" ({_told(finder.left_out)})" if finder.left_out else ""),
            file=file,
            place="candidates",
            expected="kinds that the twin has within_m of its middle, or places",
        )
    return Mounts((*own, *found), dict(sorted(finder.left_out.items())))


def _told(counts: Counter[str]) -> str:
    return ", ".join(f"{many} {what}" for what, many in sorted(counts.items()))


class _Finder:
    def __init__(self, spec: PlaceSpec, twin: Twin, junction: Junction, file: Path | None) -> None:
        self._spec, self._twin, self._junction, self._file = spec, twin, junction, file
        self._middle = np.array(spec.middle_m)
        self._mesh = twin.mesh
        self._is_ground = self._mesh.is_ground
        _, self._part = np.unique(self._mesh.part, return_inverse=True)
        ground = self._mesh.select(self._is_ground)
        if not len(ground.faces):
            raise InputError("the twin has no ground", expected="a twin with ground")
        self._probe = DownwardProbe(ground)
        self._above = float(self._mesh.vertices[:, 2].max()) + 1.0
        self.left_out: Counter[str] = Counter()

    def own(self, number: int, one: OwnPlace) -> Mount:
        """Return the mount of a place given by the user."""
        place = f"candidates.places[{number}]"
        ground = self._ground(one.east_m, one.north_m)
        where = f"{one.east_m:g} m east, {one.north_m:g} m north"
        if np.isnan(ground):
            raise InputError(
                f"{one.name!r}: no ground at {where} of the anchor",
                file=self._file,
                place=f"{place}.east_m",
                expected="a place on the site's ground",
            )
        heights = tuple(sorted(set(one.heights_m or self._spec.heights_m)))
        for height_m in heights:
            at = np.array([one.east_m, one.north_m, ground + height_m])
            around = enclosing(at, self._mesh)
            if around is not None:
                raise InputError(
                    f"{one.name!r}: {height_m:g} m above {where} is inside {around}",
                    file=self._file,
                    place=place,
                    expected="a place outside, or heights_m above it",
                )
        return Mount(
            one.name, one.kind, one.east_m, one.north_m, ground, heights,
            self._toward(np.array([one.east_m, one.north_m])),
        )  # fmt: skip

    def of(self, kind: MountKind) -> list[Mount]:
        """Return the mounts of a kind with the best view, in order of bearing."""
        around, within = self._spec.candidates, self._spec.candidates.within_m
        middle, sight = self._middle, self._junction.around
        if kind in ("pole", "signal"):
            places = mapped_poles(self._mesh, middle, within, signals=kind == "signal")
        elif kind == "facade":
            places = facade_places(self._mesh, middle, within, around.spacing_m, sight)
        else:
            area = self._area()
            places = new_pole_places(self._twin, middle, within, around.spacing_m, area)
        mounts = (
            self._mount(kind, one.foot + BRACKET_M * one.outward, one.top_m) for one in places
        )
        found = [(self._sees(mount), mount) for mount in mounts if mount is not None]
        seen = [(share, mount) for share, mount in found if share >= _BLIND]
        self._leave(f"{kind}s that see nothing of the junction", len(found) - len(seen))
        seen.sort(key=lambda one: -one[0])
        kept: list[Mount] = []
        for number, (_, mount) in enumerate(seen):
            if len(kept) == around.most:
                self._leave(f"{kind}s beyond candidates.most that see less", len(seen) - number)
                break
            outside = self._outside(mount)
            if outside is None:
                self._leave(f"{kind}s inside something", 1)
            else:
                kept.append(outside)
        kept.sort(key=lambda one: one.toward)
        taken = {one.name for one in self._spec.candidates.places}
        names = (name for n in count(1) if (name := f"{kind} {n}") not in taken)
        return [replace(mount, name=name) for mount, name in zip(kept, names, strict=False)]

    def _area(self) -> shapely.Polygon | None:
        """Return the area for new poles; ``None`` for no restriction."""
        around = self._spec.candidates
        if around.area is None:
            return None
        area = shapely.Polygon(around.area)
        away_m = shapely.distance(area, shapely.Point(self._middle))
        if away_m > around.within_m:
            raise InputError(
                f"lies {away_m:.0f} m from the middle of the junction",
                file=self._file,
                place="candidates.area",
                expected=f"an area within {around.within_m:g} m (within_m) of it",
            )
        return area

    def _mount(self, kind: MountKind, at: NDArray[np.float64], top_z_m: float) -> Mount | None:
        # Rounded as in a rig's file.
        at = np.round(at, 2)
        ground = self._ground(*at.tolist())
        if np.isnan(ground) or not shapely.contains_xy(self._twin.region, *at):
            self._leave(f"{kind}s outside the region or its ground", 1)
            return None
        top_m = top_z_m - ground
        heights = sorted({one for one in self._spec.heights_m if one <= top_m + _ON_TOP_M})
        if not heights and top_m >= _LOWEST_M:
            heights = [round(float(top_m), 2)]
        if not heights:
            self._leave(f"{kind}s too low", 1)
            return None
        east, north = at.tolist()
        return Mount("", kind, east, north, ground, tuple(heights), self._toward(at))

    def _outside(self, mount: Mount) -> Mount | None:
        """Return a mount with only the heights outside of objects; ``None`` if none is left."""
        low, high = self._bounds
        at = np.array([mount.east_m, mount.north_m])
        here = np.asarray(((low - _NEAR_M <= at) & (at <= high + _NEAR_M)).all(axis=1))
        things = self._mesh.select(here[self._part] & ~self._is_ground)
        heights = tuple(
            one for one in mount.heights_m if enclosing(mount.place(one), things) is None
        )
        return replace(mount, heights_m=heights) if heights else None

    @cached_property
    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Bounds in plan of each part of the scene."""
        corners = self._mesh.triangles()[:, :, :2]
        parts = int(self._part.max()) + 1
        low, high = np.full((parts, 2), np.inf), np.full((parts, 2), -np.inf)
        np.minimum.at(low, self._part, corners.min(axis=1))
        np.maximum.at(high, self._part, corners.max(axis=1))
        return low, high

    def _leave(self, reason: str, many: int) -> None:
        if many > 0:
            self.left_out[reason] += many

    def _ground(self, east_m: float, north_m: float) -> float:
        return float(self._probe.height_below(np.array([[east_m, north_m, self._above]]))[0])

    def _toward(self, at: NDArray[np.float64]) -> float:
        east, north = self._middle - at
        return float(np.arctan2(north, east))

    def _sees(self, mount: Mount) -> float:
        """Return the share of lanes and crossings in its line of sight, from its highest place."""
        points = self._junction.ground.points
        if not len(points):
            return 1.0
        return float(self._junction.around.sees(mount.place(mount.heights_m[-1]), points).mean())
