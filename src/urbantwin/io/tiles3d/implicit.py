"""Implicit tilings: regular quadtrees or octrees, whose subtrees list the available tiles."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

from urbantwin.io.tiles3d.tile import ContentLink, Tile, Volume
from urbantwin.io.values import (
    MalformedError,
    entry,
    items,
    parse_json,
    table,
    text,
    whole,
)

__all__ = ["SubtreeLink", "implicit_tiling", "morton", "read_subtree"]


@dataclass(frozen=True)
class Availability:
    """One bit per tile, by level and along the Morton curve.

    Attributes:
        constant: common value of all, or ``None``.
        bits: packed, the least significant first.
    """

    constant: bool | None
    bits: bytes

    def __getitem__(self, index: int) -> bool:
        """Return whether tile ``index`` is available."""
        if self.constant is not None:
            return self.constant
        return bool(self.bits[index >> 3] >> (index & 7) & 1)


@dataclass(frozen=True)
class Subtree:
    """Availability of a subtree's tiles, contents and child subtrees."""

    tiles: Availability
    contents: tuple[Availability, ...]
    children: Availability


def morton(place: tuple[int, ...]) -> int:
    """Return the Morton index of x, y (and z): bits interleaved, those of x least significant."""
    result, width = 0, len(place)
    for axis, value in enumerate(place):
        bit = 0
        while value >> bit:
            result |= (value >> bit & 1) << (bit * width + axis)
            bit += 1
    return result


def read_subtree(
    data: bytes, levels: int, branches: int, resolve: Callable[[str], bytes]
) -> Subtree:
    """Read a subtree, binary or JSON.

    Args:
        data: its bytes.
        levels: number of its levels.
        branches: children of a tile: 4 or 8.
        resolve: returns the bytes of external buffers.

    Source: 3D Tiles 1.1, section "Subtrees"; ``3DTILES_implicit_tiling`` of 1.0, whose
    ``bufferView`` became ``bitstream``.

    Raises:
        MalformedError: it is invalid, or too short for its levels.
    """
    binary = b""
    if data[:4] == b"subt":
        if len(data) < 24:
            raise MalformedError("ends within its header")
        version, json_length, binary_length = struct.unpack_from("<IQQ", data, 4)
        if version != 1:
            raise MalformedError(f"is a subtree of version {version}, and not 1")
        if 24 + json_length + binary_length > len(data):
            raise MalformedError("ends early")
        document = parse_json(data[24 : 24 + json_length].rstrip(b" \0"), "its JSON part")
        binary = data[24 + json_length : 24 + json_length + binary_length]
    else:
        document = parse_json(data, "it")
    tiles = (branches**levels - 1) // (branches - 1)
    views = _Views(document, binary, resolve)
    content = document.get("contentAvailability")
    if isinstance(content, dict):
        content = [content]
    several = table(table(document, "extensions"), "3DTILES_multiple_contents")
    contents = (content or []) + items(several, "contentAvailability")
    return Subtree(
        views.availability(document.get("tileAvailability"), tiles),
        tuple(views.availability(entry, tiles) for entry in contents),
        views.availability(document.get("childSubtreeAvailability"), branches**levels),
    )


class _Views:
    """Views of a subtree's buffers."""

    def __init__(
        self, document: dict[str, Any], binary: bytes, resolve: Callable[[str], bytes]
    ) -> None:
        self._document = document
        self._binary = binary
        self._resolve = resolve
        self._buffers: dict[int, bytes] = {}

    def availability(self, spec: object, count: int) -> Availability:
        """Return an availability of ``count`` bits."""
        if not isinstance(spec, dict):
            raise MalformedError("has an availability that is not an object")
        if spec.get("constant") is not None:
            return Availability(bool(spec["constant"]), b"")
        key = "bitstream" if "bitstream" in spec else "bufferView"
        bits = self._view(whole(spec, key))
        if len(bits) * 8 < count:
            raise MalformedError(f"has {len(bits) * 8} bits for {count} tiles")
        return Availability(None, bits)

    def _view(self, number: int) -> bytes:
        view = entry(self._document, "bufferViews", number)
        which = whole(view, "buffer")
        if which not in self._buffers:
            uri = text(entry(self._document, "buffers", which), "uri")
            self._buffers[which] = self._resolve(uri) if uri else self._binary
        start, length = whole(view, "byteOffset", 0), whole(view, "byteLength")
        data = self._buffers[which]
        if start + length > len(data):
            raise MalformedError("has a bufferView that runs beyond its buffer")
        return data[start : start + length]


@dataclass(frozen=True, eq=False)
class Tiling:
    """A regular subdivision of a tile.

    Attributes:
        volume: volume of its root, in the tileset's frame.
        error: geometric error of its root, metres.
        axes: 2 for a quadtree, 3 for an octree.
        levels: levels of a subtree.
        available: total number of levels.
        subtrees: template of the subtrees' URIs.
        contents: templates of the contents' URIs.
    """

    volume: Volume
    error: float
    axes: int
    levels: int
    available: int
    subtrees: str
    contents: tuple[str, ...]

    @property
    def branches(self) -> int:
        """Number of children of a tile."""
        return 1 << self.axes

    def uri(self, template: str, level: int, place: tuple[int, ...]) -> str:
        """Return a template with its variables filled in."""
        values = dict(zip("xyz", place, strict=False), level=level)
        return re.sub(
            r"\{(level|x|y|z)\}", lambda match: str(values.get(match[1], match[0])), template
        )


@dataclass(frozen=True, eq=False)
class SubtreeLink:
    """A subtree that must be read before its root tile is known.

    Attributes:
        tiling: its tiling.
        level: level of its root tile.
        place: coordinates of its root tile: x, y (and z).
    """

    tiling: Tiling
    level: int
    place: tuple[int, ...]

    @property
    def uri(self) -> str:
        """URI of the subtree."""
        return self.tiling.uri(self.tiling.subtrees, self.level, self.place)

    def tiles(self, parent: Tile) -> Iterator[Tile | MalformedError]:
        """Yield nothing: the subtree has not been read."""
        return iter(())

    def top(self, tile: Tile, subtree: Subtree) -> bool:
        """Set a tile to the root of its loaded subtree; return False if it is not available."""
        if not subtree.tiles[0]:
            return False
        cell = Cell(self.tiling, subtree, self, 0, (0,) * self.tiling.axes)
        tile.links, tile.below = cell.links(), None if cell.is_leaf() else cell
        return True


@dataclass(frozen=True, eq=False)
class Cell:
    """A tile of an implicit tiling, as source of its children.

    Attributes:
        tiling: its tiling.
        subtree: its subtree.
        link: link of the subtree.
        depth: level within the subtree.
        local: coordinates within the subtree's level.
    """

    tiling: Tiling
    subtree: Subtree
    link: SubtreeLink
    depth: int
    local: tuple[int, ...]

    @property
    def level(self) -> int:
        """Level within the whole tiling."""
        return self.link.level + self.depth

    @property
    def place(self) -> tuple[int, ...]:
        """Coordinates within the whole tiling's level."""
        pairs = zip(self.link.place, self.local, strict=True)
        return tuple((top << self.depth) + own for top, own in pairs)

    def links(self) -> tuple[ContentLink, ...]:
        """Return its contents."""
        branches = self.tiling.branches
        index = (branches**self.depth - 1) // (branches - 1) + morton(self.local)
        return tuple(
            ContentLink(self.tiling.uri(template, self.level, self.place))
            for template, there in zip(self.tiling.contents, self.subtree.contents, strict=False)
            if there[index]
        )

    def is_leaf(self) -> bool:
        """Return whether it has no children."""
        return next(self._available(), None) is None

    def tiles(self, parent: Tile) -> Iterator[Tile | MalformedError]:
        """Yield the children; roots of further subtrees have a link as their ``below``."""
        tiling, level, depth = self.tiling, self.level + 1, self.depth + 1
        for local in self._available():
            if depth < tiling.levels:
                cell = Cell(tiling, self.subtree, self.link, depth, local)
                yield _tile(parent, tiling, level, cell.place, cell)
                continue
            pairs = zip(self.link.place, local, strict=True)
            place = tuple((top << depth) + own for top, own in pairs)
            yield _tile(parent, tiling, level, place, SubtreeLink(tiling, level, place))

    def _available(self) -> Iterator[tuple[int, ...]]:
        """Yield the coordinates, in the subtree's next level, of available children."""
        tiling, depth = self.tiling, self.depth + 1
        if self.level + 1 >= tiling.available:
            return
        first = (tiling.branches**depth - 1) // (tiling.branches - 1)
        for step in product((0, 1), repeat=tiling.axes):
            local = tuple(2 * at + s for at, s in zip(self.local, reversed(step), strict=True))
            index = morton(local)
            within = depth < tiling.levels
            if self.subtree.tiles[first + index] if within else self.subtree.children[index]:
                yield local


def _tile(
    parent: Tile, tiling: Tiling, level: int, place: tuple[int, ...], below: Cell | SubtreeLink
) -> Tile:
    """Return a tile of a tiling; error and volume halve level by level."""
    return Tile(
        parent,
        parent.tileset,
        tiling.volume.part(level, place),
        parent.transform,
        tiling.error / 2.0**level,
        parent.replaces,
        below.links() if isinstance(below, Cell) else (),
        None if isinstance(below, Cell) and below.is_leaf() else below,
        parent.depth + 1,
    )


def implicit_tiling(spec: dict[str, Any], tile: Tile) -> SubtreeLink | None:
    """Return the first subtree of an implicitly tiled tile, ``None`` for other tiles.

    Source: 3D Tiles 1.1, section "Implicit Tiling"; ``3DTILES_implicit_tiling`` of 1.0.

    Raises:
        MalformedError: the tiling is invalid.
    """
    implicit = table(spec, "implicitTiling") or table(
        table(spec, "extensions"), "3DTILES_implicit_tiling"
    )
    if not implicit:
        return None
    scheme = text(implicit, "subdivisionScheme")
    if scheme not in ("QUADTREE", "OCTREE"):
        raise MalformedError(f"is subdivided by {scheme!r:.40}, and not as QUADTREE or OCTREE")
    axes, levels = (2, 3)[scheme == "OCTREE"], whole(implicit, "subtreeLevels")
    available = (
        whole(implicit, "availableLevels")
        if "availableLevels" in implicit
        else whole(implicit, "maximumLevel") + 1
    )
    if not 1 <= levels <= 24 // axes or not 1 <= available <= 48:
        raise MalformedError(f"has {available} levels, {levels} in a subtree")
    if tile.volume.kind == "sphere":
        raise MalformedError("is tiled implicitly within a sphere")
    uri = text(table(implicit, "subtrees"), "uri")
    if not uri:
        raise MalformedError("has subtrees without a uri")
    tiling = Tiling(
        tile.volume,
        tile.error,
        axes,
        levels,
        available,
        uri,
        tuple(link.uri for link in tile.links),
    )
    return SubtreeLink(tiling, 0, (0,) * axes)
