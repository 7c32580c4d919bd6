"""A tile of the tree that a tileset describes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.tiles3d.bounding_volume import Volume

__all__ = ["Below", "ContentLink", "Tile", "Tileset"]


@dataclass(frozen=True, eq=False)
class Tileset:
    """One tileset file.

    Attributes:
        address: where it lies.
        axis: (3, 3) from the axes of its glTF to z up.
        chain: the tilesets that it is inside of, outermost first, itself last.
    """

    address: str
    axis: NDArray[np.float64]
    chain: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ContentLink:
    """A content that a tile names.

    Attributes:
        uri: as the tileset has it.
        volume: its own bounding volume in the tileset's frame, or ``None``.
    """

    uri: str
    volume: Volume | None = None

    @property
    def is_tileset(self) -> bool:
        """Whether its name says that it is a further tileset."""
        return self.uri.split("?")[0].split("#")[0].lower().endswith(".json")


class Below(Protocol):
    """What stands below a tile: children written out, or implied by a tiling."""

    def tiles(self, parent: Tile) -> Iterator[Tile | MalformedError]:
        """Yield the children; one that cannot be read as its error."""


@dataclass(eq=False)
class Tile:
    """A tile, and what became of it.

    Attributes:
        parent: the tile that it refines, or ``None``.
        tileset: the file that it is of.
        volume: where its content lies, in the tileset's frame.
        transform: (4, 4) from the tile to the tileset's frame, its parents' included.
        error: geometric error, metres.
        replaces: whether its children replace its content, or add to it.
        links: its contents.
        below: its children, or ``None`` for a leaf.
        depth: how many tiles are above it.
        requested_near: whether viewers ask for it only from close by (which is ignored).
        wanted: the contents that are to be read.
        loaded: whether any of them was.
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
