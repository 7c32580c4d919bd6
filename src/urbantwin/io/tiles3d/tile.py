"""Tiles of a tileset and their bounding volumes: regions of the ellipsoid, boxes and spheres."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from urbantwin.io.values import MalformedError, numbers, table

__all__ = ["ContentLink", "Tile", "Tileset", "Volume", "geodetic_from_ecef", "read_volume"]

#: Tolerance of containment, metres, as stored volumes are rounded.
_SLACK_M = 0.05


@lru_cache(maxsize=1)
def _geodetic() -> Transformer:
    return Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


def geodetic_from_ecef(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3) longitude, latitude (radians) and ellipsoidal height of (N, 3) EPSG:4978."""
    lon, lat, height = _geodetic().transform(points[:, 0], points[:, 1], points[:, 2])
    return np.column_stack([np.radians(lon), np.radians(lat), height])


@dataclass(frozen=True, eq=False)
class Volume:
    """Bounding volume of a tile's content, in the tileset's own frame.

    Attributes:
        kind: ``region``, ``box``, ``sphere``; ``cell`` (of S2), treated as the whole Earth, or
            ``unknown``, treated as unbounded.
        values: region: west, south, east, north (radians, east > west), lowest, highest (metres
            above the ellipsoid); box: centre and three half axes; sphere: centre and radius.
    """

    kind: Literal["region", "box", "sphere", "cell", "unknown"]
    values: NDArray[np.float64]

    def transformed(self, transform: NDArray[np.float64]) -> Volume:
        """Return it transformed by (4, 4), which does not apply to regions."""
        if self.kind in ("region", "cell", "unknown"):
            return self
        values, linear = self.values.copy(), transform[:3, :3]
        values[:3] = linear @ values[:3] + transform[:3, 3]
        if self.kind == "box":
            values[3:] = (values[3:].reshape(3, 3) @ linear.T).reshape(-1)
        else:
            values[3] *= float(np.linalg.norm(linear, 2))
        return replace(self, values=values)

    def corners(self) -> NDArray[np.float64]:
        """Return the (8, 3) corners of a box, or of the cube around a sphere."""
        axes = self.values[3:].reshape(3, 3) if self.kind == "box" else np.eye(3) * self.values[3]
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        return np.asarray(self.values[:3] + signs @ axes)

    def part(self, level: int, place: tuple[int, ...]) -> Volume:
        """Return the cell at ``place`` (x, y or x, y, z) of a regular subdivision.

        Source: 3D Tiles 1.1, section "Implicit Tiling", "Subdivision Rules".
        """
        at, size = np.array([*place, 0][:3], np.float64), 2.0**level
        cells = np.array([size, size, size if len(place) == 3 else 1.0])
        values = self.values.copy()
        if self.kind == "region":
            low, high = values[[0, 1, 4]], values[[2, 3, 5]]
            step = (high - low) / cells
            values[[0, 1, 4]], values[[2, 3, 5]] = low + at * step, low + (at + 1) * step
        elif self.kind == "box":
            axes = values[3:].reshape(3, 3)
            values[:3] += ((2 * at + 1) / cells - 1) @ axes
            values[3:] = (axes / cells[:, None]).reshape(-1)
        else:
            return self
        return replace(self, values=values)

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the mask of (N, 3) points of the tileset's frame inside."""
        v = self.values
        if self.kind == "region":
            lon, lat, height = geodetic_from_ecef(points).T
            slack = _SLACK_M / 6.4e6
            # longitudes are relative to the region's west
            turn = np.mod(lon - v[0] + slack, 2 * math.pi)
            inside = (turn <= v[2] - v[0] + 2 * slack) & (lat >= v[1] - slack)
            inside &= (lat <= v[3] + slack) & (height >= v[4] - 1.0) & (height <= v[5] + 1.0)
            return np.asarray(inside)
        if self.kind == "sphere":
            distance = np.linalg.norm(points - v[:3], axis=1)
            return np.asarray(distance <= v[3] + _SLACK_M)
        if self.kind == "box":
            # the box's own coordinates, also for axes that are not orthogonal
            axes = v[3:].reshape(3, 3)
            length = np.maximum(np.linalg.norm(axes, axis=1), 1e-12)
            unit = axes / length[:, None]
            local = (points - v[:3]) @ np.linalg.pinv(unit)
            return np.asarray((np.abs(local) <= length + _SLACK_M).all(axis=1))
        return np.ones(len(points), bool)


def read_volume(spec: dict[str, Any]) -> Volume:
    """Return a ``boundingVolume``; an unknown kind is unbounded.

    Source: 3D Tiles 1.1, section "Bounding Volumes".

    Raises:
        MalformedError: its numbers do not match its kind.
    """
    volume = table(spec, "boundingVolume")
    if volume.get("region") is not None:
        values = numbers(volume, "region", 6)
        if values[2] < values[0]:
            values[2] += 2 * math.pi
        if abs(values[[1, 3]]).max() > 1.5708 or values[3] < values[1]:
            raise MalformedError("has a region that is not on the ellipsoid")
        values[[4, 5]] = np.sort(values[[4, 5]])
        return Volume("region", values)
    if volume.get("box") is not None:
        return Volume("box", numbers(volume, "box", 12))
    if volume.get("sphere") is not None:
        values = numbers(volume, "sphere", 4)
        if values[3] < 0:
            raise MalformedError("has a sphere of negative radius")
        return Volume("sphere", values)
    on_cells = "3DTILES_bounding_volume_S2" in table(volume, "extensions")
    return Volume("cell" if on_cells else "unknown", np.zeros(0))


@dataclass(frozen=True, eq=False)
class Tileset:
    """One tileset file.

    Attributes:
        address: its address.
        axis: (3, 3) from the axes of its glTF to z up.
        chain: the enclosing tilesets, outermost first, itself last.
    """

    address: str
    axis: NDArray[np.float64]
    chain: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ContentLink:
    """A content reference of a tile.

    Attributes:
        uri: URI in the tileset.
        volume: its own bounding volume in the tileset's frame, or ``None``.
    """

    uri: str
    volume: Volume | None = None

    @property
    def is_tileset(self) -> bool:
        """Whether its name is that of another tileset."""
        return self.uri.split("?")[0].split("#")[0].lower().endswith(".json")


class Below(Protocol):
    """Children of a tile: explicit, or implied by a tiling."""

    def tiles(self, parent: Tile) -> Iterator[Tile | MalformedError]:
        """Yield the children, or the error of an unreadable one."""


@dataclass(eq=False)
class Tile:
    """A tile, and the state of its loading.

    Attributes:
        parent: the tile that it refines, or ``None``.
        tileset: its tileset file.
        volume: bounding volume of its content, in the tileset's frame.
        transform: (4, 4) from the tile to the tileset's frame, including its parents'.
        error: geometric error, metres.
        replaces: whether its children replace its content, or add to it.
        links: its contents.
        below: its children, or ``None`` for a leaf.
        depth: number of its ancestors.
        requested_near: whether it has a viewer request volume (which is ignored).
        wanted: the contents selected for reading.
        loaded: whether any of them was read.
        opened: whether its children were visited.
    """

    parent: Tile | None
    tileset: Tileset
    volume: Volume
    transform: NDArray[np.float64]
    error: float
    replaces: bool
    links: tuple[ContentLink, ...]
    below: Below | None
    depth: int
    requested_near: bool = False
    wanted: tuple[ContentLink, ...] = ()
    loaded: bool = False
    opened: bool = False
