"""The tree of nodes of a glTF document, flattened: which mesh stands where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.reconstruct.gltf.accessors import Accessors
from urbantwin.reconstruct.gltf.untrusted_values import (
    MalformedError,
    items,
    matrix,
    numbers,
    table,
    text,
    whole,
)

__all__ = ["PlacedMesh", "placed_meshes"]

_MOST_NODES = 1_000_000
_DEEPEST = 256


@dataclass(frozen=True)
class PlacedMesh:
    """A mesh at its places.

    Attributes:
        mesh: its number in the document.
        name: of its node.
        transforms: (I, 4, 4) float64, from the mesh to the scene.
        node: number of its node.
    """

    mesh: int
    name: str
    transforms: NDArray[np.float64]
    node: int


def placed_meshes(
    document: dict[str, Any], accessors: Accessors, problems: list[str]
) -> Iterator[PlacedMesh]:
    """Yield the meshes of the scene, node by node, parents before their children.

    A node that does not exist, that is reached twice (a cycle, two parents) or that cannot be
    understood is left out with all below it, and is a line of ``problems``.

    Source: glTF 2.0, section 3.5 "Scenes" (nodes are strict trees); ``EXT_mesh_gpu_instancing``.

    Raises:
        MalformedError: there is no scene, or its nodes are beyond reason.
    """
    nodes = items(document, "nodes")
    pending = [(number, np.eye(4), 0) for number in reversed(_roots(document, nodes))]
    seen: set[int] = set()
    while pending:
        number, above, depth = pending.pop()
        if depth > _DEEPEST or len(seen) > _MOST_NODES:
            raise MalformedError("has nodes nested or numbered beyond reason")
        try:
            if number >= len(nodes) or not isinstance(nodes[number], dict):
                raise MalformedError("does not exist")
            if number in seen:
                raise MalformedError("is reached twice: nodes are not a tree")
            seen.add(number)
            node: dict[str, Any] = nodes[number]
            here = above @ _local(node)
            below = [
                whole({"child": child}, "child") for child in reversed(items(node, "children"))
            ]
            placed = _placed(node, number, here, accessors)
        except MalformedError as error:
            problems.append(f"node {number} {error}")
            continue
        if placed is not None:
            yield placed
        pending.extend((child, here, depth + 1) for child in below)


def _placed(
    node: dict[str, Any], number: int, here: NDArray[np.float64], accessors: Accessors
) -> PlacedMesh | None:
    """Return the mesh of a node, if it has one, at all its places."""
    if node.get("mesh") is None:
        return None
    instances = table(table(node, "extensions"), "EXT_mesh_gpu_instancing")
    transforms = here @ _instances(instances, accessors) if instances else here[None]
    return PlacedMesh(whole(node, "mesh"), text(node, "name"), transforms, number)


def _roots(document: dict[str, Any], nodes: list[Any]) -> list[int]:
    """Return the root nodes of the scene that is shown; of all nodes where there is no scene."""
    scenes = items(document, "scenes")
    if scenes:
        number = whole(document, "scene", 0)
        if number >= len(scenes) or not isinstance(scenes[number], dict):
            raise MalformedError(f"refers to scene {number}, which it does not have")
        return [whole({"node": node}, "node") for node in items(scenes[number], "nodes")]
    below = {
        child
        for node in nodes
        if isinstance(node, dict)
        for child in items(node, "children")
        if isinstance(child, int)
    }
    return [number for number in range(len(nodes)) if number not in below]


def _local(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return a node's own transform: its matrix, or translation x rotation x scale."""
    if node.get("matrix") is not None:
        return matrix(node, "matrix")
    result = np.eye(4)
    rotation = numbers(node, "rotation", 4, [0.0, 0.0, 0.0, 1.0])
    if not np.linalg.norm(rotation) > 1e-9:
        raise MalformedError("has a rotation that is zero")
    result[:3, :3] = Rotation.from_quat(rotation).as_matrix()
    result[:3, :3] *= numbers(node, "scale", 3, [1.0, 1.0, 1.0])
    result[:3, 3] = numbers(node, "translation", 3, [0.0, 0.0, 0.0])
    return result


def _instances(extension: dict[str, Any], accessors: Accessors) -> NDArray[np.float64]:
    """Return (I, 4, 4) transforms of instances within their node."""
    attributes = table(extension, "attributes")
    columns = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}
    read = {}
    for key, width in columns.items():
        if attributes.get(key) is not None:
            read[key] = accessors.values(whole(attributes, key))
            if read[key].shape[1] != width:
                raise MalformedError(f"has instances with a {key} of {read[key].shape[1]} numbers")
    counts = {len(rows) for rows in read.values()}
    if len(counts) != 1:
        raise MalformedError("has instances with attributes of different lengths")
    count = counts.pop()
    if not all(np.isfinite(rows).all() for rows in read.values()):
        raise MalformedError("has instances whose places are not finite")
    result = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    if "ROTATION" in read and count:
        if not (np.linalg.norm(read["ROTATION"], axis=1) > 1e-9).all():
            raise MalformedError("has an instance whose rotation is zero")
        result[:, :3, :3] = Rotation.from_quat(read["ROTATION"]).as_matrix()
    if "SCALE" in read:
        result[:, :3, :3] *= read["SCALE"][:, None, :]
    if "TRANSLATION" in read:
        result[:, :3, 3] = read["TRANSLATION"]
    return result
