"""The content of one tile, whatever its format, in the tile's own frame, z up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.gltf.scene import read_scene
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.model import PointCloud, TriangleMesh

__all__ = ["Content", "Context", "read_model"]


@dataclass
class Content:
    """What a tile holds.

    Attributes:
        meshes: triangles, z up, in the tile's frame.
        clouds: points, z up, in the tile's frame.
        problems: what was left out, a line each.
        copyright: who made it, as it says itself.
    """

    meshes: list[TriangleMesh] = field(default_factory=list)
    clouds: list[PointCloud] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    copyright: set[str] = field(default_factory=set)

    def add(self, other: Content) -> None:
        """Add what another content holds."""
        self.meshes += other.meshes
        self.clouds += other.clouds
        self.problems += other.problems
        self.copyright |= other.copyright


@dataclass(frozen=True, eq=False)
class Context:
    """What a tile's content cannot know by itself.

    Attributes:
        resolve: gives the bytes of a URI relative to the tile.
        axis: (3, 3) from glTF's axes to z up.
        transform: (4, 4) from the tile to the tileset's frame.
        spend: told how many triangles and points are about to be made; it refuses too many.
    """

    resolve: Callable[[str], bytes]
    axis: NDArray[np.float64]
    transform: NDArray[np.float64]
    spend: Callable[[int], None]


def read_model(
    data: bytes,
    context: Context,
    *,
    feature_names: Sequence[str] = (),
    centre: NDArray[np.float64] | None = None,
) -> Content:
    """Read the glTF of a tile, turn it z up, and move it to its centre.

    Source: 3D Tiles 1.1, sections "y-up to z-up" and "Transforms"; the centre, be it
    ``RTC_CENTER`` or ``CESIUM_RTC``, is added after the turn.

    Raises:
        MalformedError: nothing of it can be read.
    """
    scene = read_scene(data, context.resolve, feature_names=feature_names)
    offset = np.zeros(3)
    for part in (centre, scene.centre):
        if part is not None:
            offset = offset + part
    content = Content(problems=list(scene.problems))
    if scene.copyright:
        content.copyright.add(scene.copyright)
    context.spend(
        sum(len(mesh.faces) for mesh in scene.meshes)
        + sum(len(cloud.points) for cloud in scene.clouds)
    )
    for mesh in scene.meshes:
        vertices = mesh.vertices @ context.axis.T + offset
        content.meshes.append(
            TriangleMesh(vertices, mesh.faces, mesh.colour, mesh.object, mesh.names)
        )
    for cloud in scene.clouds:
        content.clouds.append(PointCloud(cloud.points @ context.axis.T + offset, cloud.colour))
    if scene.problems and not content.meshes and not content.clouds:
        raise MalformedError(scene.problems[0])
    return content
