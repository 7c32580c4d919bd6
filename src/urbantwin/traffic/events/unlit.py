"""A bicycle without lights and reflectors, its rider in dark clothes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa

from urbantwin.taxonomy import material_id
from urbantwin.traffic.assets.asset_name import AssetName
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.motion_rows import as_rows

__all__ = ["unlit"]

#: What each material becomes: nothing sends light back, and cloth is as dark as rubber.
_BECOMES = {
    **dict.fromkeys(
        ("retroreflector", "reflex-reflector", "lamp-lens", "paint-white"), "metal-dark"
    ),
    "cloth": "rubber",
}


def unlit(motion: Motion, track: int) -> Motion:
    """Return a motion in which one track's mesh has no reflectors; it gets a name of its own."""
    table = motion.actors
    tracks = table["track"].to_numpy()
    names = np.asarray(table["asset"].to_numpy(zero_copy_only=False), object).copy()
    mine = tracks == track
    meshes = dict(motion.meshes)
    renamed = {}
    for name in sorted(set(names[mine].tolist())):
        usual = AssetName.of(name)
        dark = usual._replace(body=f"{usual.body}-unlit")
        renamed[name] = str(dark)
        for (asset, phase), mesh in motion.meshes.items():
            if asset != usual.unsized:
                continue
            material = mesh.material.copy()
            for before, after in _BECOMES.items():
                material[mesh.material == material_id(before)] = material_id(after)
            meshes[dark.unsized, phase] = replace(mesh, material=material)
    names[mine] = [renamed[name] for name in names[mine]]
    place = table.schema.get_field_index("asset")
    changed = table.set_column(place, table.schema.field(place), pa.array(names.tolist()))
    shown = {*names.tolist(), *motion.parked["asset"].to_pylist()}
    used = {AssetName.of(name).unsized for name in shown}
    return replace(
        motion,
        rows=as_rows(changed),
        meshes={key: mesh for key, mesh in sorted(meshes.items()) if key[0] in used},
    )
