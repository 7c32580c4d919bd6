"""Scaling of actors relative to the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pyarrow as pa

from urbantwin.traffic.assets import AssetName, sized_name
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.motion_rows import as_rows

__all__ = ["resized"]

_AXES = ("length", "width", "height")


def resized(motion: Motion, size: Mapping[str, Mapping[str, float]]) -> Motion:
    """Return a motion with scaled actors on unchanged paths.

    Sizes are rounded to whole centimetres.

    Args:
        motion: a motion with the meshes of its actors.
        size: factors of ``length``, ``width`` and ``height`` by class; 1 if not given.
    """
    if not size:
        return motion
    factors = {
        name: [float(scale.get(axis, 1.0)) for axis in _AXES] for name, scale in size.items()
    }
    manifest = {**motion.manifest, "size": {k: dict(v) for k, v in size.items()}}
    return replace(
        motion,
        manifest=manifest,
        rows=as_rows(_with_scaled_sizes(motion.actors, factors)),
        parked=_with_scaled_sizes(motion.parked, factors),
    ).with_meshes()


def _with_scaled_sizes(table: pa.Table, factors: Mapping[str, list[float]]) -> pa.Table:
    """Return a table of actors with scaled sizes and the matching names of assets."""
    if not table.num_rows:
        return table
    assets = table["asset"].combine_chunks().dictionary_encode()
    index = assets.indices.to_numpy()
    _, first = np.unique(index, return_index=True)
    classes = [table["class"][int(row)].as_py() for row in first]
    names = assets.dictionary.to_pylist()
    sides = np.array([[table[axis][int(row)].as_py() for axis in _AXES] for row in first])
    for number, name in enumerate(classes):
        if name in factors:
            sides[number] = np.maximum(np.round(sides[number] * factors[name], 2), 0.01)
            names[number] = sized_name(AssetName.of(names[number]).unsized, *sides[number])
    shown = pa.DictionaryArray.from_arrays(assets.indices, pa.array(names)).cast(pa.string())
    columns = {"asset": shown}
    columns |= {axis: pa.array(sides[index, number]) for number, axis in enumerate(_AXES)}
    for name, column in columns.items():
        place = table.schema.get_field_index(name)
        table = table.set_column(place, table.schema.field(place), column)
    return table
