"""Tileset files: JSON that describes a tree of tiles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.gltf.primitive import FARTHEST
from urbantwin.io.gltf.scene import Y_UP_TO_Z_UP
from urbantwin.io.tiles3d.implicit import implicit_tiling
from urbantwin.io.tiles3d.tile import ContentLink, Tile, Tileset, read_volume
from urbantwin.io.values import (
    MalformedError,
    items,
    matrix,
    numbers,
    parse_json,
    table,
    text,
)

__all__ = ["is_tileset", "read_tileset"]

_AXES = {
    "X": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    "Y": Y_UP_TO_Z_UP,
    "Z": np.eye(3),
}


def is_tileset(data: bytes) -> bool:
    """Return whether JSON content is a tileset, not glTF."""
    if data[:64].lstrip(b"\xef\xbb\xbf \t\r\n")[:1] != b"{":
        return False
    try:
        return "root" in parse_json(data, "it")
    except MalformedError:
        return False


def read_tileset(data: bytes, address: str, parent: Tile | None) -> Tile:
    """Return the root of a tileset.

    Args:
        data: the bytes of its JSON.
        address: its address.
        parent: the tile whose content it is.

    Source: 3D Tiles 1.1, sections "Tileset JSON" and "External tilesets"; ``asset.gltfUpAxis`` of
    drafts before 1.0.

    Raises:
        MalformedError: it is not a tileset.
    """
    document = parse_json(data, "it")
    if not isinstance(document.get("root"), dict):
        raise MalformedError("has no root: it is not a tileset")
    up = text(table(document, "asset"), "gltfUpAxis", "Y").upper()
    if up not in _AXES:
        raise MalformedError(f"has an asset.gltfUpAxis of {up!r:.20}")
    chain = () if parent is None else parent.tileset.chain
    spec = document["root"]
    if spec.get("geometricError") is None and parent is None:
        # without a stated error, only the finest tiles suffice
        spec = {**spec, "geometricError": document.get("geometricError", 1e12)}
    return _tile(spec, parent, Tileset(address, _AXES[up], (*chain, address)))


class _Written:
    """Explicit children in the tileset's JSON."""

    def __init__(self, specs: list[Any]) -> None:
        self._specs = specs

    def tiles(self, parent: Tile) -> Iterator[Tile | MalformedError]:
        """Yield the children."""
        for spec in self._specs:
            try:
                if not isinstance(spec, dict):
                    raise MalformedError("a child is not an object")
                yield _tile(spec, parent, parent.tileset)
            except MalformedError as error:
                yield error


def _links(spec: dict[str, Any], transform: NDArray[np.float64]) -> tuple[ContentLink, ...]:
    """Return the contents of a tile: ``content``, ``contents``, and the extension of 1.0."""
    found: list[Any] = []
    if spec.get("content") is not None:
        found.append(spec["content"])
    found += items(spec, "contents")
    several = table(table(spec, "extensions"), "3DTILES_multiple_contents")
    found += items(several, "contents") or items(several, "content")
    links = []
    for entry in found:
        if not isinstance(entry, dict):
            raise MalformedError("has a content that is not an object")
        # named url before 1.0
        uri = text(entry, "uri") or text(entry, "url")
        if not uri:
            raise MalformedError("has a content without a uri")
        volume = None
        if entry.get("boundingVolume") is not None:
            volume = read_volume(entry).transformed(transform)
        links.append(ContentLink(uri, volume))
    return tuple(links)


def _tile(spec: dict[str, Any], parent: Tile | None, tileset: Tileset) -> Tile:
    """Return a tile from its JSON.

    Source: 3D Tiles 1.1, sections "Tiles", "Transforms", "Refinement".

    Raises:
        MalformedError: it is invalid.
    """
    transform = matrix(spec, "transform")
    if parent is not None:
        transform = parent.transform @ transform
    if not (np.abs(transform) < FARTHEST).all():
        raise MalformedError("has a transform without bounds")
    error = 0.0 if parent is None else parent.error
    if spec.get("geometricError") is not None:
        error = float(numbers({"e": [spec["geometricError"]]}, "e", 1)[0])
    refine = text(spec, "refine").upper()
    replaces = refine == "REPLACE" if refine else parent is None or parent.replaces
    children = items(spec, "children")
    tile = Tile(
        parent,
        tileset,
        read_volume(spec).transformed(transform),
        transform,
        error,
        replaces,
        _links(spec, transform),
        _Written(children) if children else None,
        0 if parent is None else parent.depth + 1,
        "viewerRequestVolume" in spec,
    )
    tiling = implicit_tiling(spec, tile)
    if tiling is not None:
        tile.links, tile.below = (), tiling
    return tile
