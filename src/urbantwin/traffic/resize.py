"""Scaling of actors relative to the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pyarrow as pa

from urbantwin.traffic.assets import AssetName
from urbantwin.traffic.motion import Motion

__all__ = ["resized"]

_AXES = ("length", "width", "height")


def resized(motion: Motion, size: Mapping[str, Mapping[str, float]]) -> Motion:
    """Return a motion with actors of other sizes; where they go stays.

    Args:
        motion: with the meshes of its actors.
        size: by class, factors of ``length``, ``width`` and ``height``; 1 where not given.
    """
    if not size:
        return motion
    factors = {name: [float(one.get(axis, 1.0)) for axis in _AXES] for name, one in size.items()}
    classes = motion.actors["class"].to_pylist()
    by_row = np.array([factors.get(name, [1.0, 1.0, 1.0]) for name in classes]).reshape(-1, 3)
    actors = motion.actors
    for number, axis in enumerate(_AXES):
        place = actors.schema.get_field_index(axis)
        values = actors[axis].to_numpy() * by_row[:, number]
        actors = actors.set_column(place, actors.schema.field(axis), pa.array(values))
    pairs = actors.select(["asset", "class"]).group_by(["asset", "class"]).aggregate([])
    shown = {
        AssetName.of(name).unsized: actor_class
        for name, actor_class in zip(
            pairs["asset"].to_pylist(), pairs["class"].to_pylist(), strict=True
        )
    }
    meshes = {
        (asset, phase): replace(mesh, vertices=mesh.vertices * factors[shown[asset]])
        if shown.get(asset) in factors
        else mesh
        for (asset, phase), mesh in motion.with_meshes().meshes.items()
    }
    manifest = {**motion.manifest, "size": {k: dict(v) for k, v in size.items()}}
    return Motion(manifest, actors, motion.signals, meshes)
