"""Traversal of a tileset, and loading of the selected tiles in its frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.io.gltf.primitive import FARTHEST
from urbantwin.io.gltf.scene import MOST_TRIANGLES, shown
from urbantwin.io.model import PointCloud, TriangleMesh
from urbantwin.io.tiles3d.content import Content, Context
from urbantwin.io.tiles3d.formats import read_content
from urbantwin.io.tiles3d.implicit import SubtreeLink, read_subtree
from urbantwin.io.tiles3d.region import Interest
from urbantwin.io.tiles3d.store import TileFiles
from urbantwin.io.tiles3d.tile import ContentLink, Tile
from urbantwin.io.tiles3d.tileset import is_tileset, read_tileset
from urbantwin.io.values import MalformedError

__all__ = ["Reading", "Traversal"]

_DEEPEST_NESTING = 64
_DEEPEST = 512
_MOST_TILES = 200_000


class Traversal:
    """Walks tilesets, external and implicit ones included, down to a geometric error.

    Source: 3D Tiles 1.1, sections "Geometric Error" and "Refinement". A tile's content is selected
    if its error is small enough, if it is a leaf, or if its children add to it. An empty tile is
    always refined. Tiles outside of the region are skipped.

    Args:
        files: access to the files.
        interest: the region.
        target_m: the geometric error to reach, metres.

    Attributes:
        tiles: every tile that intersects the region, parents before their children.
        failed: tiles with a selected but unreadable part.
        problems: unreadable parts, a line each.
    """

    def __init__(self, files: TileFiles, interest: Interest, target_m: float) -> None:
        self._files = files
        self._interest = interest
        self._target = target_m
        self.tiles: list[Tile] = []
        self.failed: list[Tile] = []
        self.problems: list[str] = []

    def fail(self, tile: Tile, problem: str) -> None:
        """Record that a part of a tile cannot be read."""
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
        """Continue below an unreadable tile; return False if it has no children."""
        if tile.opened or tile.below is None:
            return False
        children = self._children(tile)
        self._walk(children)
        return bool(children)

    def _walk(self, tiles: Iterable[Tile]) -> None:
        """Visit tiles and their descendants; files of further tiles are fetched in batches."""
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
        """Visit tiles and their descendants; return the further files that they need."""
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
        """Select the contents of a tile; return the tilesets among them."""
        links = [
            link for link in tile.links if link.volume is None or self._interest.meets(link.volume)
        ]
        if not self._goes_on(tile) or not tile.replaces:
            tile.wanted = tuple(link for link in links if not link.is_tileset)
        return [asked for link in links if link.is_tileset for asked in self._asked(tile, link.uri)]

    def _goes_on(self, tile: Tile) -> bool:
        """Return whether a tile is refined."""
        if tile.below is None:
            return False
        return tile.error > self._target or all(link.is_tileset for link in tile.links)

    def _children(self, tile: Tile) -> list[Tile]:
        """Return the children of a tile that intersect the region."""
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
        """Attach a loaded subtree, and continue below its root."""

        def resolve(uri: str) -> bytes:
            return self._files.read(self._files.resolve(address, uri))

        subtree = read_subtree(data, link.tiling.levels, link.tiling.branches, resolve)
        tile.below = None
        if not link.top(tile, subtree):
            return []
        return self._descend([tile])

    def selected(self, known: int) -> Iterator[tuple[Tile, ContentLink]]:
        """Yield the selected contents of tiles after the first ``known``."""
        for tile in self.tiles[known:]:
            for link in tile.wanted:
                yield tile, link


#: Maximum number of triangles and points of a source near the region.
_MOST_KEPT = 10_000_000


class Reading:
    """Reads contents; failed tiles are replaced by finer or coarser ones.

    An unreadable tile is refined if it has children. Otherwise it is filled from the nearest
    ancestor that it replaces, with the ancestor's triangles that are inside the failed tile's
    volume and in no volume of a loaded tile.

    Attributes:
        content: all content, in the tileset's frame.
        read: number of contents read.
        filled: number of tiles filled from an ancestor.
    """

    def __init__(
        self,
        files: TileFiles,
        interest: Interest,
        traversal: Traversal,
        progress: Callable[[float, str], None],
    ) -> None:
        self._files = files
        self._interest = interest
        self._traversal = traversal
        self._tell = progress
        self._left = _MOST_KEPT
        self.content = Content()
        self.read = 0
        self.filled = 0
        self._holes: list[Tile] = []

    def run(self) -> None:
        """Read all selected contents, and substitutes for failed ones."""
        traversal, known, handled = self._traversal, 0, 0
        while True:
            while known < len(traversal.tiles):
                pending = list(traversal.selected(known))
                known = len(traversal.tiles)
                self._read(pending)
            failed, handled = traversal.failed[handled:], len(traversal.failed)
            leaves = [tile for tile in dict.fromkeys(failed) if not traversal.refine(tile)]
            if known == len(traversal.tiles):
                # which volumes are filled is known only after everything is read
                self._fill([*self._holes, *leaves])
                return
            self._holes += leaves

    def _read(self, pending: list[tuple[Tile, ContentLink]]) -> None:
        """Read contents; failures are recorded in the traversal."""
        asked: list[tuple[Tile, str]] = []
        for tile, link in pending:
            try:
                asked.append((tile, self._files.resolve(tile.tileset.address, link.uri)))
            except MalformedError as error:
                self._traversal.fail(tile, f"{shown(self._files.hidden(link.uri))} {error}")
        everything = self._files.read_all([address for _, address in asked])
        for number, ((tile, address), data) in enumerate(zip(asked, everything, strict=True)):
            self._tell(number / len(asked), f"tile {number + 1} of {len(asked)}")
            try:
                if isinstance(data, MalformedError):
                    raise data
                if is_tileset(data):
                    self._traversal.open_external(tile, address, data)
                else:
                    self._keep(self._opened(tile, address, data))
                tile.loaded = True
            except MalformedError as error:
                self._traversal.fail(tile, f"{self._files.name(address)}: {error}")

    def _opened(self, tile: Tile, address: str, data: bytes) -> Content:
        """Return a content in the tileset's frame, with objects named after the tile."""
        spent = 0

        def resolve(uri: str) -> bytes:
            try:
                return self._files.read(self._files.resolve(address, uri))
            except MalformedError as error:
                raise MalformedError(f"{shown(self._files.hidden(uri))} {error}") from None

        def spend(count: int) -> None:
            nonlocal spent
            spent += count
            if spent > MOST_TRIANGLES:
                raise MalformedError(f"unfolds to more than {MOST_TRIANGLES} triangles")

        content = read_content(data, Context(resolve, tile.tileset.axis, tile.transform, spend))
        name = shown(self._files.name(address))
        meshes = [self._moved(mesh, tile.transform, name) for mesh in content.meshes]
        clouds = [self._moved_cloud(cloud, tile.transform) for cloud in content.clouds]
        self.read += 1
        return Content(
            [mesh for mesh in meshes if len(mesh.faces)],
            [cloud for cloud in clouds if len(cloud.points)],
            [f"{name}: {problem}" for problem in content.problems],
            content.copyright,
        )

    def _moved(self, mesh: TriangleMesh, transform: NDArray[np.float64], name: str) -> TriangleMesh:
        vertices = mesh.vertices @ transform[:3, :3].T + transform[:3, 3]
        if not (np.abs(vertices) < FARTHEST).all():
            raise MalformedError("has vertices without bounds")
        faces = mesh.faces
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = np.ascontiguousarray(faces[:, ::-1])
        names = tuple(f"{name} / {part}" for part in mesh.names)
        moved = TriangleMesh(vertices, faces, mesh.colour, mesh.object, names)
        near = self._interest.near(vertices, faces)
        return moved if near is None else moved.select(near)

    def _moved_cloud(self, cloud: PointCloud, transform: NDArray[np.float64]) -> PointCloud:
        points = cloud.points @ transform[:3, :3].T + transform[:3, 3]
        if not (np.abs(points) < FARTHEST).all():
            raise MalformedError("has points without bounds")
        moved = PointCloud(points, cloud.colour)
        near = self._interest.near_points(points)
        return moved if near is None else moved.select(near)

    def _keep(self, content: Content) -> None:
        self._left -= sum(len(mesh.faces) for mesh in content.meshes)
        self._left -= sum(len(cloud.points) for cloud in content.clouds)
        if self._left < 0:
            raise InputError(
                f"has more than {_MOST_KEPT} triangles and points near the region",
                file=self._files.root,
                expected="a larger geometric_error_m, or a smaller region",
            )
        self.content.add(content)

    def _fill(self, holes: list[Tile]) -> None:
        """Fill failed tiles from the nearest ancestors with a content of their own."""
        standing: dict[Tile, Content | None] = {}
        below: dict[Tile, list[Tile]] = {}
        for hole in dict.fromkeys(holes):
            if hole.loaded:
                continue
            ancestor = hole
            while ancestor.parent is not None and ancestor.parent.replaces:
                ancestor = ancestor.parent
                if ancestor.wanted and ancestor.loaded:
                    break
                if ancestor not in standing:
                    standing[ancestor] = self._stand_in(ancestor)
                if standing[ancestor] is not None:
                    below.setdefault(ancestor, []).append(hole)
                    break
        for ancestor, failed in below.items():
            content = standing[ancestor]
            assert content is not None
            loaded = [
                tile
                for tile in self._traversal.tiles
                if tile.loaded and tile is not ancestor and _is_below(tile, ancestor)
            ]
            self.filled += len(failed)
            content.meshes = [_clipped(mesh, failed, loaded) for mesh in content.meshes]
            content.clouds = [_clipped_cloud(cloud, failed, loaded) for cloud in content.clouds]
            self._keep(content)

    def _stand_in(self, tile: Tile) -> Content | None:
        """Return the content of a refined tile, or ``None`` if it is empty."""
        whole = Content()
        for link in tile.links:
            if link.is_tileset:
                continue
            try:
                address = self._files.resolve(tile.tileset.address, link.uri)
                data = self._files.read(address)
                if not is_tileset(data):
                    whole.add(self._opened(tile, address, data))
            except MalformedError as error:
                self._traversal.problems.append(f"{shown(self._files.hidden(link.uri))}: {error}")
        return whole if whole.meshes or whole.clouds else None


def _is_below(tile: Tile, ancestor: Tile) -> bool:
    above: Tile | None = tile
    while above is not None and above is not ancestor:
        above = above.parent
    return above is ancestor


def _chosen(
    points: NDArray[np.float64], failed: list[Tile], loaded: list[Tile]
) -> NDArray[np.bool_]:
    """Return the mask of points (N, 3) in failed tiles, and if possible in no loaded one."""
    inside = np.zeros(len(points), bool)
    for tile in failed:
        inside |= tile.volume.contains(points)
    free = inside.copy()
    for tile in loaded:
        at = np.flatnonzero(free)
        if not len(at):
            break
        free[at] &= ~tile.volume.contains(points[at])
    return free if free.any() else inside


def _clipped(mesh: TriangleMesh, failed: list[Tile], loaded: list[Tile]) -> TriangleMesh:
    return mesh.select(_chosen(mesh.triangles().mean(axis=1), failed, loaded))


def _clipped_cloud(cloud: PointCloud, failed: list[Tile], loaded: list[Tile]) -> PointCloud:
    return cloud.select(_chosen(cloud.points, failed, loaded))
