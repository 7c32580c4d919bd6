"""Loading the contents of the selected tiles, in the tileset's frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.reconstruct.gltf.primitive import FARTHEST
from urbantwin.reconstruct.gltf.scene import MOST_TRIANGLES, shown
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.model import PointCloud, TriangleMesh
from urbantwin.reconstruct.tiles3d.content import Content, Context
from urbantwin.reconstruct.tiles3d.content_format import read_content
from urbantwin.reconstruct.tiles3d.fetching import TileFiles
from urbantwin.reconstruct.tiles3d.region_of_interest import Interest
from urbantwin.reconstruct.tiles3d.tile import ContentLink, Tile
from urbantwin.reconstruct.tiles3d.tileset import is_tileset
from urbantwin.reconstruct.tiles3d.traversal import Traversal

__all__ = ["Reading"]

#: Triangles and points that a source may keep near the region.
_MOST_KEPT = 10_000_000


class Reading:
    """Reads contents; where one fails, finer or coarser tiles take its place.

    A tile that is good enough but cannot be read is refined instead. What cannot be refined is
    filled from the nearest ancestor that it replaces: with the ancestor's triangles inside the
    failed tile's volume that lie in no volume of a tile that did load.

    Attributes:
        content: everything that was read, in the tileset's frame.
        read: how many contents were read.
        filled: how many tiles an ancestor stands in for.
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
        """Read all that is wanted, and stand-ins for what fails."""
        traversal, known, handled = self._traversal, 0, 0
        while True:
            while known < len(traversal.tiles):
                pending = list(traversal.selected(known))
                known = len(traversal.tiles)
                self._read(pending)
            failed, handled = traversal.failed[handled:], len(traversal.failed)
            leaves = [tile for tile in dict.fromkeys(failed) if not traversal.refine(tile)]
            if known == len(traversal.tiles):
                # Only when everything is read is it known which volumes are filled.
                self._fill([*self._holes, *leaves])
                return
            self._holes += leaves

    def _read(self, pending: list[tuple[Tile, ContentLink]]) -> None:
        """Read contents; failures are noted in the traversal."""
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
        """Return a content in the tileset's frame, its objects named after the tile."""
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
        """Fill failed tiles from the nearest ancestors that have a content of their own."""
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
        """Return the content of a tile that was refined, or ``None`` where it gives nothing."""
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
    """Return which points (N, 3) lie in failed tiles, and in no loaded one if that leaves any."""
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
