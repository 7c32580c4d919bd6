"""The traversal of a tileset: which tiles are selected, and what replaces those that fail."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from urbantwin.errors import InputError
from urbantwin.reconstruct.gltf.scene import shown
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.tiles3d.fetching import TileFiles
from urbantwin.reconstruct.tiles3d.implicit_tiling import SubtreeLink
from urbantwin.reconstruct.tiles3d.region_of_interest import Interest
from urbantwin.reconstruct.tiles3d.subtree import read_subtree
from urbantwin.reconstruct.tiles3d.tile import ContentLink, Tile
from urbantwin.reconstruct.tiles3d.tileset import read_tileset

__all__ = ["Traversal"]

_DEEPEST_NESTING = 64
_DEEPEST = 512
_MOST_TILES = 200_000


class Traversal:
    """Walks tilesets, external and implicit ones included, down to a geometric error.

    Source: 3D Tiles 1.1, sections "Geometric Error" and "Refinement". A tile whose error is small
    enough, or that nothing refines, gives its content; so does one that its children add to. An
    empty tile is always refined. Tiles that do not meet the region are not looked into.

    Args:
        files: gives the files.
        interest: the region.
        target_m: the geometric error that is good enough.

    Attributes:
        tiles: every tile that meets the region, parents before their children.
        failed: tiles of which something that was wanted cannot be read.
        problems: what cannot be read, a line each.
    """

    def __init__(self, files: TileFiles, interest: Interest, target_m: float) -> None:
        self._files = files
        self._interest = interest
        self._target = target_m
        self.tiles: list[Tile] = []
        self.failed: list[Tile] = []
        self.problems: list[str] = []

    def fail(self, tile: Tile, problem: str) -> None:
        """Note that something of a tile cannot be read."""
        self.failed.append(tile)
        self.problems.append(problem)

    def start(self, root: Tile) -> None:
        """Walk from a root."""
        self._walk([root])

    def open_external(self, tile: Tile, address: str, data: bytes) -> None:
        """Walk into a tileset that is the content of a tile.

        Raises:
            MalformedError: it is not a tileset, or contains itself.
        """
        self._walk([self._external(tile, address, data)])

    def refine(self, tile: Tile) -> bool:
        """Walk on below a tile that was good enough but cannot be read; false if it is a leaf."""
        if tile.opened or tile.below is None:
            return False
        children = self._children(tile)
        self._walk(children)
        return bool(children)

    def _walk(self, tiles: Iterable[Tile]) -> None:
        """Visit tiles and all below them; files that describe more tiles are fetched by waves."""
        waiting = self._descend(tiles)
        while waiting:
            addresses = [address for _, address, _ in waiting]
            wave, waiting = waiting, []
            for (tile, address, link), data in zip(
                wave, self._files.read_all(addresses), strict=True
            ):
                try:
                    if isinstance(data, MalformedError):
                        raise data
                    if link is None:
                        waiting += self._descend([self._external(tile, address, data)])
                    else:
                        waiting += self._planted(tile, address, link, data)
                except MalformedError as error:
                    self.fail(tile, f"{self._files.name(address)}: {error}")

    def _descend(self, tiles: Iterable[Tile]) -> list[tuple[Tile, str, SubtreeLink | None]]:
        """Visit tiles and those below; return the further files that they need."""
        waiting: list[tuple[Tile, str, SubtreeLink | None]] = []
        stack = [tile for tile in tiles if self._interest.meets(tile.volume)][::-1]
        while stack:
            tile = stack.pop()
            if isinstance(tile.below, SubtreeLink):
                waiting += self._asked(tile, tile.below.uri, tile.below)
                continue
            self.tiles.append(tile)
            if len(self.tiles) > _MOST_TILES:
                raise InputError(
                    f"has more than {_MOST_TILES} tiles that meet the region",
                    file=self._files.name(tile.tileset.chain[0]),
                    expected="a larger geometric_error_m, or a smaller region",
                )
            waiting += self._visited(tile)
            if self._goes_on(tile):
                stack += self._children(tile)[::-1]
        return waiting

    def _visited(self, tile: Tile) -> list[tuple[Tile, str, SubtreeLink | None]]:
        """Decide what is wanted of a tile; return the tilesets among its contents."""
        links = [
            link for link in tile.links if link.volume is None or self._interest.meets(link.volume)
        ]
        if not self._goes_on(tile) or not tile.replaces:
            tile.wanted = tuple(link for link in links if not link.is_tileset)
        return [asked for link in links if link.is_tileset for asked in self._asked(tile, link.uri)]

    def _goes_on(self, tile: Tile) -> bool:
        """Return whether a tile is to be refined."""
        if tile.below is None:
            return False
        return tile.error > self._target or all(link.is_tileset for link in tile.links)

    def _children(self, tile: Tile) -> list[Tile]:
        """Return the children of a tile that meet the region."""
        tile.opened = True
        children: list[Tile] = []
        if tile.below is None:
            return children
        if tile.depth > _DEEPEST:
            self.problems.append(
                f"{self._files.name(tile.tileset.address)}: tiles are nested beyond {_DEEPEST}"
            )
            return children
        for child in tile.below.tiles(tile):
            if isinstance(child, MalformedError):
                name = self._files.name(tile.tileset.address)
                self.problems.append(f"{name}: a tile {child}")
            elif self._interest.meets(child.volume):
                children.append(child)
        return children

    def _asked(
        self, tile: Tile, uri: str, link: SubtreeLink | None = None
    ) -> list[tuple[Tile, str, SubtreeLink | None]]:
        try:
            return [(tile, self._files.resolve(tile.tileset.address, uri), link)]
        except MalformedError as error:
            self.fail(tile, f"{shown(self._files.hidden(uri))} {error}")
            return []

    def _external(self, tile: Tile, address: str, data: bytes) -> Tile:
        if address in tile.tileset.chain:
            raise MalformedError("contains itself")
        if len(tile.tileset.chain) >= _DEEPEST_NESTING:
            raise MalformedError(f"is nested in more than {_DEEPEST_NESTING} tilesets")
        return read_tileset(data, address, tile)

    def _planted(
        self, tile: Tile, address: str, link: SubtreeLink, data: bytes
    ) -> list[tuple[Tile, str, SubtreeLink | None]]:
        """Take a subtree that was read, and go on below its top."""

        def resolve(uri: str) -> bytes:
            return self._files.read(self._files.resolve(address, uri))

        subtree = read_subtree(data, link.tiling.levels, link.tiling.branches, resolve)
        tile.below = None
        if not link.top(tile, subtree):
            return []
        return self._descend([tile])

    def selected(self, known: int) -> Iterator[tuple[Tile, ContentLink]]:
        """Yield the contents that are wanted of tiles after the first ``known``."""
        for tile in self.tiles[known:]:
            for link in tile.wanted:
                yield tile, link
