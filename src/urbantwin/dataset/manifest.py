"""``dataset.json``: everything that is needed to reproduce a dataset."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import platform
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin import __version__
from urbantwin.artefact import as_json
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.named_inputs import named_inputs, told_of
from urbantwin.dataset.object_statistics import object_statistics
from urbantwin.dataset.reading.manifest import pose_matrix
from urbantwin.dataset.result_warnings import BEYOND, warnings_of_record
from urbantwin.dataset.split.time_split import warnings_of_split
from urbantwin.geometry import Pose
from urbantwin.lidar import MountedSensor, Rig, Sensor
from urbantwin.result_warning import rows_of, warnings_of
from urbantwin.taxonomy import ACTOR_CLASSES, OBSTACLE, semantic_classes
from urbantwin.traffic.fingerprint import mesh_sha256, meshes_sha256, table_sha256

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = [
    "FORMAT",
    "LAYOUT",
    "frame_sha256",
    "frames_of",
    "hashes_of",
    "manifest_of",
    "manifest_of_parts",
    "recipe_key",
    "recipe_of",
    "recipe_of_rig",
    "versions_here",
]

#: Version of the meaning of a dataset's files.
FORMAT = 2

#: Packages that affect the bytes.
_DEPENDENCIES = (
    *("eclipse-sumo", "embreex", "fast-simplification", "laspy", "libsumo", "numba", "numpy"),
    *("osmium", "pillow", "pyarrow", "pyproj", "pythoncdt", "rasterio", "scipy", "shapely"),
)
#: Hashes of the twin and the motion.
_HASHES = ("scene_sha256", "surface_sha256", "motion_sha256", "meshes_sha256")

LAYOUT = {
    "points": "points/NNNNNN.npy: (N, 4) float32, x, y, z in metres and intensity 0..1",
    "labels": "labels/NNNNNN.txt: x y z dx dy dz heading class, metres and radians",
    "semantic": "semantic/NNNNNN.label: (N,) uint32, class in the low 16 bits, track in the high",
    "rays": "rays/NNNNNN.npy: (N,) sensor u1, ring u2, column u2, time f4 (seconds from the "
    "frame's time, by the sensor's clock), echo u1",
    "boxes": "boxes.parquet: one row per frame and box",
    "ignore_regions": "ignore_regions.geojson: where labels do not count, site frame, metres",
    "sweeps": "sweeps.parquet: one row per frame, sensor and turn: times, and poses in the site",
    "tracks": "tracks.parquet: one row per track: who it is, its first and last frame",
    "tracklets": "tracklets.parquet: one row per track and frame: its box, site frame",
    "trajectories": "trajectories.parquet: one row per track and step of the motion, site frame",
    "poses": "poses.parquet: where the ego and each sensor were, site frame",
    "lanes": "lanes.parquet: one row per lane of the twin, if it has some: its middle, site frame",
    "ImageSets": "train.txt, val.txt, test.txt: names of the frames of each part, see split",
}
#: Layout of points in column formats.
_PACKED = {
    "zstd": "points/NNNNNN.parquet: x, y, z in metres and intensity 0..1 (f4), semantic, instance "
    "(u2), sensor u1, ring u2, column u2, time f4, echo u1: as in npy, nothing lost",
    "laz": "points/NNNNNN.laz: LAS 1.4, point format 6; whole millimetres, intensity 0..65535, "
    "gps_time in seconds from the frame's time; ring, column, sensor, echo, semantic and instance "
    "as extra bytes",
}


def recipe_of(  # noqa: PLR0913 - a recipe is made of all of it
    twin: Twin,
    motion: Motion,
    rig: Rig,
    seed: int,
    times_s: Mapping[int, float],
    backend: str = "embree",
    asked: Mapping[str, Any] | None = None,
    storage: str = "npy",
    *,
    hashes: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return everything that determines the frames; a resumed run must have the same.

    Args:
        twin: the twin.
        motion: the motion on it.
        rig: the sensors.
        seed: random seed.
        times_s: frame number -> time.
        backend: ray tracer, see `lidar.Scanner`.
        asked: requested rig, see `provenance.asked_of`, and requested split, see `SplitAsked.told`.
        storage: format of points, see `layout.write_frame`.
        hashes: `hashes_of` the twin and the motion, if already known.
    """
    times = list(times_s.values())
    return {
        "kind": "dataset",
        "format": FORMAT,
        "urbantwin": __version__,
        **versions_here(backend),
        "backend": backend,
        "storage": storage,
        "seeds": {"record": seed, "traffic": motion.manifest["seed"]},
        **recipe_of_rig(rig),
        "anchor": twin.manifest["anchor"],
        "region_m": twin.manifest["region_m"],
        **(hashes_of(twin, motion) if hashes is None else hashes),
        "inputs": named_inputs(twin.manifest, motion.manifest, asked),
        "about": told_of(twin.manifest, motion.manifest),
        "made_from": {
            "twin": _part(twin.manifest, "version", "made_from"),
            "motion": _part(motion.manifest, "urbantwin", "asked", "made"),
            "record": None if asked is None else {**asked, **_span(times_s), "storage": storage},
        },
        "start_s": times[0],
        "frames": [frame_name(index) for index in times_s],
    }


def hashes_of(twin: Twin, motion: Motion) -> dict[str, Any]:
    """Return the SHA-256 of the static world, its motion and the actors' meshes."""
    return {
        "scene_sha256": mesh_sha256(twin.mesh),
        "surface_sha256": twin.manifest.get("files", {}).get("surface_material.npz"),
        "motion_sha256": table_sha256(motion.rows),
        "meshes_sha256": meshes_sha256(motion.meshes),
    }


def _span(times_s: Mapping[int, float]) -> dict[str, Any]:
    """Return the recorded interval, and N if only every N-th frame was recorded."""
    numbers, times = list(times_s), list(times_s.values())
    every = numbers[1] - numbers[0] if len(numbers) > 1 else 1
    return {"span_s": [times[0], times[-1]]} | ({"every": every} if every > 1 else {})


def versions_here(backend: str | None = None) -> dict[str, Any]:
    """Return what affects the bytes on this machine: versions of packages, and platform."""
    names = (*_DEPENDENCIES, "warp-lang") if backend and "warp" in backend else _DEPENDENCIES
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "dependencies": dict(_installed(names)),
    }


def _installed(names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield each installed package and its version: Embree has no wheel for every platform."""
    for name in names:
        with suppress(PackageNotFoundError):
            yield name, version(name)


def recipe_of_rig(rig: Rig) -> dict[str, Any]:
    """Return the part of a recipe that describes the sensors."""
    return {
        "frame": rig.frame,
        # For a rig on an actor each frame has its own.
        "dataset_SE3_site": None if rig.ride else pose_matrix(rig.dataset_SE3_site),
        "rig": {
            "rate_hz": rig.rate_hz,
            "frame": rig.frame,
            "fused": rig.fused,
            "boxes": rig.boxes,
            **({} if rig.label_range_m is None else {"label_range_m": rig.label_range_m}),
            "conditions": as_json(rig.conditions),
            "ride": as_json(rig.ride),
            "carrier": rig.carrier,
            "sensors": [_mounted(mounted) for mounted in rig.sensors],
        },
    }


def recipe_key(recipe: Mapping[str, Any]) -> str:
    """Return a short hash of a recipe."""
    text = json.dumps(recipe, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def manifest_of(
    recipe: Mapping[str, Any],
    times_s: Mapping[int, float],
    entries: Sequence[Mapping[str, Any]],
    split: Mapping[str, Any],
    tables: Mapping[str, str],
) -> dict[str, Any]:
    """Return the content of ``dataset.json``.

    Args:
        recipe: see `recipe_of`.
        times_s: frame number -> time.
        entries: return value of ``layout.write_frame`` for each frame, in the same order.
        split: description of the split, see `split.split_in_time`.
        tables: SHA-256 of every file that belongs to no single frame, by name.
    """
    boxes, seen, in_reach, seen_in_reach = (Counter[str]() for _ in range(4))
    for entry in entries:
        columns = entry["boxes"]
        hit, reached = columns["num_points"] > 0, ~np.isin(columns["ignored"], BEYOND)
        boxes.update(columns["class"].tolist())
        seen.update(columns["class"][hit].tolist())
        in_reach.update(columns["class"][reached].tolist())
        seen_in_reach.update(columns["class"][reached & hit].tolist())
    classes = [*ACTOR_CLASSES, *([OBSTACLE] if boxes[OBSTACLE] else [])]
    about = (recipe.get("about") or {}).get("warnings") or {}
    driven = warnings_of({"warnings": about.get("motion")})
    turns = [turn for entry in entries for turn in entry["sweeps"]]
    points: Counter[int] = Counter()
    for entry in entries:
        points.update({int(number): count for number, count in entry["semantic"].items()})
    frames = frames_of(times_s, entries)
    return {
        **{key: value for key, value in recipe.items() if key not in ("frames", "start_s")},
        "layout": _layout(recipe["storage"]),
        "class_names": classes,
        "point_cloud_range": _point_cloud_range(entries),
        "objects": object_statistics(entries, recipe["dataset_SE3_site"]),
        "counts": {
            "frames": len(frames),
            **{part: part_notes["frames"] for part, part_notes in split["parts"].items()},
            "points": sum(points.values()),
            "boxes": {name: boxes[name] for name in classes},
            "boxes_with_points": {name: seen[name] for name in classes},
            "boxes_in_reach": {name: in_reach[name] for name in classes},
            "boxes_in_reach_with_points": {name: seen_in_reach[name] for name in classes},
            "turns": len(turns),
            "turns_lost": sum(turn["lost"] for turn in turns),
            "points_by_class": {
                entry_of_class.name: points[entry_of_class.id]
                for entry_of_class in semantic_classes().values()
                if points[entry_of_class.id]
            },
        },
        "semantic_classes": [
            {
                "id": entry_of_class.id,
                "name": entry_of_class.name,
                "colour": list(entry_of_class.colour),
                "thing": entry_of_class.thing,
            }
            for entry_of_class in semantic_classes().values()
        ],
        "split": dict(split),
        "tables_sha256": dict(sorted(tables.items())),
        "warnings": rows_of([*warnings_of_record(entries, driven), *warnings_of_split(split)]),
        "frames": frames,
    }


def _layout(storage: str) -> dict[str, str]:
    """Return the description of a dataset's files."""
    packed = _PACKED.get(storage)
    if packed is None:
        return LAYOUT
    return {"points": packed} | {
        key: text for key, text in LAYOUT.items() if key not in ("points", "semantic", "rays")
    }


def frames_of(
    times_s: Mapping[int, float], entries: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Return the entry in ``dataset.json`` of each frame; arguments as of `manifest_of`."""
    return [
        {
            "name": frame_name(index),
            "time_s": time_s,
            "points": entry["points"],
            "boxes": len(entry["boxes"]["track"]),
            "sha256": frame_sha256(entry["sha256"]),
            **{key: entry[key] for key in ("dataset_SE3_site",) if key in entry},
        }
        for (index, time_s), entry in zip(times_s.items(), entries, strict=True)
    ]


def frame_sha256(sums: Mapping[str, str]) -> str:
    """Return one SHA-256 for the files of a frame: of the lines of ``sha256sum``, by name."""
    lines = "".join(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))
    return hashlib.sha256(lines.encode()).hexdigest()


def manifest_of_parts(
    recipe: Mapping[str, Any],
    parts: Mapping[str, Sequence[Mapping[str, Any]]],
    manifests: Mapping[str, str],
) -> dict[str, Any]:
    """Return the content of ``dataset.json`` of a folder with one dataset per sensor.

    Args:
        recipe: see `recipe_of`, of the whole rig.
        parts: name of each sensor and of its folder -> return values of ``layout.write_frame`` for
            each of its frames.
        manifests: name of each sensor -> SHA-256 of its dataset's manifest.
    """
    copied = ("format", "urbantwin", "python", "platform", "dependencies", "backend", "seeds")
    return {
        "kind": "datasets",
        **{key: recipe[key] for key in (*copied, *_HASHES, "inputs", "made_from")},
        "datasets": list(parts),
        "datasets_sha256": dict(manifests),
        "frames_each": len(recipe["frames"]),
        "points": {
            name: sum(entry["points"] for entry in entries) for name, entries in parts.items()
        },
    }


def _part(manifest: Mapping[str, Any], *names: str) -> dict[str, Any] | None:
    """Return fields of a manifest, or ``None`` if it lacks one of them."""
    return {key: manifest[key] for key in names} if all(map(manifest.__contains__, names)) else None


def _mounted(mounted: MountedSensor) -> dict[str, Any]:
    values = {field.name: getattr(mounted, field.name) for field in dataclasses.fields(mounted)}
    del values["sensor"]
    if mounted.pose_error is None:
        del values["pose_error"]
    if not mounted.framed_by_clock:
        del values["framed_by_clock"]
    if mounted.measured is None:
        del values["measured"]
    else:
        values["measured"] = {"sha256": mounted.measured.sha256, "fused": mounted.measured.fused}
    return {
        "name": values.pop("name"),
        "model": mounted.sensor.name,
        **{
            name: pose_matrix(value) if isinstance(value, Pose) else as_json(value)
            for name, value in values.items()
        },
        "sensor": _catalogue_entry(mounted.sensor),
    }


def _catalogue_entry(sensor: Sensor) -> dict[str, Any]:
    """Return the whole entry: a user's sensor file may not be available later."""
    values = {field.name: getattr(sensor, field.name) for field in dataclasses.fields(sensor)}
    pattern = sensor.pattern
    if pattern is not None:
        values["pattern"] = {
            "name": pattern.name,
            "period_s": pattern.period_s,
            "lines": pattern.lines,
            "sha256": pattern.sha256,
        }
    return {name: as_json(value) for name, value in values.items()}


def _point_cloud_range(entries: Sequence[Mapping[str, Any]]) -> list[float]:
    """Return least x, y, z and greatest x, y, z of all points, rounded outwards to metres."""
    bounds = np.array([entry["bounds"] for entry in entries if entry["bounds"]])
    if not len(bounds):
        return [0.0] * 6
    low, high = np.floor(bounds[:, :3].min(axis=0)), np.ceil(bounds[:, 3:].max(axis=0))
    return [float(value) + 0.0 for value in (*low, *high)]
