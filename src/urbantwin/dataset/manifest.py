"""``dataset.json``: everything that is needed to make a dataset again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from urbantwin import __version__
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.pose_matrix import pose_matrix
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import MountedSensor, Rig, Sensor
from urbantwin.taxonomy import ACTOR_CLASSES, semantic_classes

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = [
    "FORMAT",
    "LAYOUT",
    "manifest_of",
    "manifest_of_parts",
    "recipe_key",
    "recipe_of",
    "recipe_of_rig",
]

#: Changes when the meaning of a dataset's files does.
FORMAT = 2

#: What decides the bytes besides our own code.
_DEPENDENCIES = ("embreex", "numba", "numpy", "pyarrow", "scipy")

LAYOUT = {
    "points": "points/NNNNNN.npy: (N, 4) float32, x, y, z in metres and intensity 0..1",
    "labels": "labels/NNNNNN.txt: x y z dx dy dz heading class, metres and radians",
    "semantic": "semantic/NNNNNN.label: (N,) uint32, class in the low 16 bits, track in the high",
    "rays": "rays/NNNNNN.npy: (N,) sensor u1, ring u2, column u2, time f4 (seconds from the "
    "frame's time, by the sensor's clock), echo u1",
    "boxes": "boxes.parquet: one row per frame and box",
    "ignore_regions": "ignore_regions.geojson: where labels do not count, site frame, metres",
    "sweeps": "sweeps.parquet: one row per frame, sensor and turn: times, and poses in the site",
    "ImageSets": "train.txt: the first four fifths of the time; val.txt: the last fifth",
}


def recipe_of(
    twin: Twin,
    motion: Motion,
    rig: Rig,
    seed: int,
    times_s: Mapping[int, float],
    backend: str = "embree",
) -> dict[str, Any]:
    """Return all that the frames follow from: what a run that goes on must have in common.

    Args:
        twin: the twin.
        motion: the motion on it.
        rig: the sensors.
        seed: of all random numbers.
        times_s: number of each frame -> its time.
        backend: what casts the rays, see `lidar.Scanner`.
    """
    dependencies = _DEPENDENCIES if backend == "embree" else (*_DEPENDENCIES, "warp-lang")
    return {
        "kind": "dataset",
        "format": FORMAT,
        "urbantwin": __version__,
        "dependencies": {name: version(name) for name in dependencies},
        "backend": backend,
        "seeds": {"record": seed, "traffic": motion.manifest["seed"]},
        **recipe_of_rig(rig),
        "anchor": twin.manifest["anchor"],
        "region_m": twin.manifest["region_m"],
        "scene_sha256": _mesh_sha256(twin.mesh),
        "surface_sha256": twin.manifest.get("files", {}).get("surface_material.npz"),
        "motion_sha256": _table_sha256(motion.actors),
        "meshes_sha256": _meshes_sha256(motion.meshes),
        "inputs": twin.manifest["inputs"],
        "start_s": next(iter(times_s.values())),
        "frames": [frame_name(index) for index in times_s],
    }


def recipe_of_rig(rig: Rig) -> dict[str, Any]:
    """Return the part of a recipe that tells of the sensors."""
    return {
        "frame": rig.frame,
        # Of a rig that rides, each of the frames has its own.
        "dataset_SE3_site": None if rig.ride else pose_matrix(rig.dataset_SE3_site),
        "rig": {
            "rate_hz": rig.rate_hz,
            "frame": rig.frame,
            "fused": rig.fused,
            "conditions": _plain(rig.conditions),
            "ride": _plain(rig.ride),
            "carrier": rig.carrier,
            "sensors": [_mounted(one) for one in rig.sensors],
        },
    }


def recipe_key(recipe: Mapping[str, Any]) -> str:
    """Return a short name that two recipes share only if they are the same."""
    text = json.dumps(recipe, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def manifest_of(
    recipe: Mapping[str, Any],
    times_s: Mapping[int, float],
    entries: Sequence[Mapping[str, Any]],
    split: tuple[Sequence[str], Sequence[str]],
) -> dict[str, Any]:
    """Return what ``dataset.json`` holds.

    Args:
        recipe: see `recipe_of`.
        times_s: number of each frame -> its time.
        entries: what ``layout.write_frame`` returned for each frame, in the same order.
        split: names of the frames that train and that validate.
    """
    boxes = Counter(box["class"] for entry in entries for box in entry["boxes"])
    seen = Counter(
        box["class"] for entry in entries for box in entry["boxes"] if box["num_points"] > 0
    )
    turns = [turn for entry in entries for turn in entry["sweeps"]]
    points: Counter[int] = Counter()
    for entry in entries:
        points.update({int(number): count for number, count in entry["semantic"].items()})
    frames = [
        {
            "name": frame_name(index),
            "time_s": time_s,
            "points": entry["points"],
            "boxes": len(entry["boxes"]),
            **{key: entry[key] for key in ("dataset_SE3_site",) if key in entry},
        }
        for (index, time_s), entry in zip(times_s.items(), entries, strict=True)
    ]
    return {
        **{key: value for key, value in recipe.items() if key not in ("frames", "start_s")},
        "layout": LAYOUT,
        "class_names": list(ACTOR_CLASSES),
        "point_cloud_range": _point_cloud_range(entries),
        "counts": {
            "frames": len(frames),
            "train": len(split[0]),
            "val": len(split[1]),
            "points": sum(points.values()),
            "boxes": {name: boxes[name] for name in ACTOR_CLASSES},
            "boxes_with_points": {name: seen[name] for name in ACTOR_CLASSES},
            "turns": len(turns),
            "turns_lost": sum(turn["lost"] for turn in turns),
            "points_by_class": {
                one.name: points[one.id] for one in semantic_classes().values() if points[one.id]
            },
        },
        "semantic_classes": [
            {"id": one.id, "name": one.name, "colour": list(one.colour), "thing": one.thing}
            for one in semantic_classes().values()
        ],
        "frames": frames,
    }


def manifest_of_parts(
    recipe: Mapping[str, Any], parts: Mapping[str, Sequence[Mapping[str, Any]]]
) -> dict[str, Any]:
    """Return what ``dataset.json`` holds of a folder with a dataset for each sensor.

    Args:
        recipe: see `recipe_of`, of the whole rig.
        parts: name of each sensor, which is that of its folder -> what ``layout.write_frame``
            returned for each of its frames.
    """
    return {
        "kind": "datasets",
        **{key: recipe[key] for key in ("format", "urbantwin", "seeds")},
        "datasets": list(parts),
        "frames_each": len(recipe["frames"]),
        "points": {
            name: sum(entry["points"] for entry in entries) for name, entries in parts.items()
        },
    }


def _mesh_sha256(mesh: LabelledMesh) -> str:
    """Return the SHA-256 of a mesh's arrays, which does not depend on how a file packs them."""
    digest = hashlib.sha256()
    for field in dataclasses.fields(mesh):
        array = np.ascontiguousarray(getattr(mesh, field.name))
        digest.update(f"{field.name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.data)
    return digest.hexdigest()


def _meshes_sha256(meshes: Mapping[tuple[str, int], LabelledMesh]) -> str:
    """Return the SHA-256 of the actors' meshes by asset and phase."""
    parts = [(*key, _mesh_sha256(mesh)) for key, mesh in sorted(meshes.items())]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _table_sha256(table: pa.Table) -> str:
    """Return the SHA-256 of a table's values, which does not depend on how a file packs them."""
    digest = hashlib.sha256()
    for name in table.column_names:
        column = table[name].combine_chunks()
        digest.update(f"{name} {column.type} {len(column)}".encode())
        if str(column.type) == "string":
            column = column.dictionary_encode()
            digest.update(json.dumps(column.dictionary.to_pylist()).encode())
            column = column.indices
        digest.update(np.ascontiguousarray(column.to_numpy(zero_copy_only=False)).data)
    return digest.hexdigest()


def _mounted(one: MountedSensor) -> dict[str, Any]:
    values = {field.name: getattr(one, field.name) for field in dataclasses.fields(one)}
    del values["sensor"]
    if one.measured is None:
        del values["measured"]
    else:
        values["measured"] = {"sha256": one.measured.sha256, "fused": one.measured.fused}
    return {
        "name": values.pop("name"),
        "model": one.sensor.name,
        **{name: _plain(value) for name, value in values.items()},
        "sensor": _catalogue_entry(one.sensor),
    }


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return a value as JSON holds it."""
    if isinstance(value, Pose):
        return pose_matrix(value)
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", by_alias=True)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value


def _catalogue_entry(sensor: Sensor) -> dict[str, Any]:
    """Return the whole entry: a person's own sensor file may not be there the next time."""
    values = {field.name: getattr(sensor, field.name) for field in dataclasses.fields(sensor)}
    pattern = sensor.pattern
    if pattern is not None:
        values["pattern"] = {
            "name": pattern.name,
            "period_s": pattern.period_s,
            "lines": pattern.lines,
            "sha256": pattern.sha256,
        }
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in values.items()
    }


def _point_cloud_range(entries: Sequence[Mapping[str, Any]]) -> list[float]:
    """Return least x, y, z and greatest x, y, z of all points, outwards to whole metres."""
    bounds = np.array([entry["bounds"] for entry in entries if entry["bounds"]])
    if not len(bounds):
        return [0.0] * 6
    low, high = np.floor(bounds[:, :3].min(axis=0)), np.ceil(bounds[:, 3:].max(axis=0))
    return [float(value) + 0.0 for value in (*low, *high)]
