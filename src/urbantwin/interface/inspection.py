"""Summaries of files and folders."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from urbantwin.artefact import kind_of
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.opening import opened_artefact
from urbantwin.interface.place import AnyPath
from urbantwin.interface.site_file import Site
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary
from urbantwin.progress import Progress, untold

__all__ = ["info", "summary_of"]

MANIFESTS = ("twin", "motion", "dataset", "report", "coverage", "sequence", "fleet", "campaign")
CLOUDS = (".npy", ".bin", ".pcd", ".ply")
EXPECTED = (
    "a twin, motion, dataset, fleet, report, coverage or sequence; a site.yaml, rig.yaml, "
    "nodes.yaml or sensor; an "
    "OpenStreetMap extract (.osm, .osm.bz2, .osm.gz, .osm.pbf), a map of the roads (.xodr, "
    "Lanelet2 .osm), a DEM (.tif), a cloud (.npy, .bin, .pcd, .ply), a recording (KITTI, "
    "nuScenes, Argoverse 2 and others, a ROS bag, MCAP, .pcap) or geometry (.glb, .gltf, "
    ".obj, .ply, .stl, .fbx, .las, .laz, .e57, CityJSON, CityGML, tileset.json, .3tz, a folder of "
    "photogrammetry)"
)
GEOMETRY = (
    *(".glb", ".gltf", ".obj", ".stl", ".fbx", ".las", ".laz", ".json", ".jsonl", ".cityjson"),
    *(".gml", ".citygml", ".gml.gz", ".citygml.gz", ".e57"),
    *(".3tz", ".b3dm", ".i3dm", ".pnts", ".cmpt", ".xyz", ".pts"),
)


@command
def info(
    path: AnyPath,
    *,
    progress: ShowProgress = True,
) -> Summary:
    """Print what a file or a folder holds.

    Args:
        path: twin, motion, dataset, report, coverage or sequence; a site.yaml, rig.yaml or sensor;
            an OpenStreetMap extract, a DEM, a cloud, a recording or a file of geometry.
        progress: show progress; or a function that is called with (share, doing).

    Returns:
        The kind and JSON-compatible values.

    Raises:
        InputError: the path is missing, damaged, or of no known kind.

    Example:
        $ urbantwin info urbantwin-demo/dataset
    """
    with shown_stage("info", progress, brief=True) as tell:
        return summary_of(Path(path), tell)


def summary_of(path: Path, progress: Progress = untold) -> Summary:
    """Return the content of a file or folder: its kind first, then JSON-compatible values.

    Args:
        path: a file or a folder.
        progress: called with the fraction (0..1) of a large map that is read.

    Raises:
        InputError: the path is missing, damaged, or of no known kind.
    """
    from urbantwin.fidelity.readers.layouts import layout_of
    from urbantwin.fidelity.readers.recording import file_and_choice

    place, choice = file_and_choice(path)
    if not place.exists():
        raise InputError("not found", file=path, expected=EXPECTED)
    if choice is not None:
        return Summary({"path": str(path), **_recording(path)})
    describe = _folder if path.is_dir() else _by_ending(path.name.lower(), progress)
    if describe is None and layout_of(path) is not None:  # recognised by its content
        describe = _recording
    if describe is None:
        raise InputError("is nothing that UrbanTwin knows", file=path, expected=EXPECTED)
    return Summary({"path": str(path), **describe(path)})


def _by_ending(name: str, progress: Progress) -> Callable[[Path], dict[str, Any]] | None:
    if name.removesuffix(".json") in MANIFESTS:
        return lambda path: _folder(path.parent)
    for endings, describe in (
        ((".yaml", ".yml"), _yaml),
        ((".xodr",), _roads),
        ((".osm",), partial(_extract_or_roads, progress=progress)),
        ((".osm.bz2", ".osm.gz", ".pbf", ".xml"), partial(_extract, progress=progress)),
        ((".tif", ".tiff"), _dem),
        ((".ply",), _mesh_or_cloud),
        (CLOUDS, _cloud),
        ((".pcap", ".pcapng", ".cap", ".bag", ".db3", ".mcap", ".parquet", ".tar"), _recording),
        ((".json",), _json),
        (GEOMETRY, _geometry),
    ):
        if name.endswith(endings):
            return describe
    return None


def _folder(folder: Path) -> dict[str, Any]:
    if kind_of(folder / "index") == "campaign":
        folder = folder / "index"
    for kind in MANIFESTS:
        if (folder / f"{kind}.json").is_file():
            return _without_path(opened_artefact(folder, kind).summary())
    parts = {kind: _folder(folder / kind) for kind in MANIFESTS if (folder / kind).is_dir()}
    if parts:
        return {"kind": "run", **parts}
    if (folder / "site.yaml").is_file():
        return _yaml(folder / "site.yaml")

    from urbantwin.fidelity.clouds import cloud_files
    from urbantwin.fidelity.readers.layouts import layout_of, recordings_inside
    from urbantwin.io import holds_model

    layout = layout_of(folder)
    model = (folder / "tileset.json").is_file() or (layout is None and holds_model(folder))
    if model:
        return _geometry(folder)
    if layout is None and not recordings_inside(folder):
        raise InputError("holds nothing that UrbanTwin knows", file=folder, expected=EXPECTED)
    if layout != "plain":
        return _recording(folder)
    return {
        "kind": "clouds",
        "frames": len(cloud_files(folder)),
        "first": _cloud(cloud_files(folder)[0]),
    }


def _recording(path: Path) -> dict[str, Any]:
    """Return a summary of a recording of a known layout: its frames, and the first frame."""
    import numpy as np

    from urbantwin.fidelity.readers import open_recording
    from urbantwin.fidelity.readers.layouts import LAYOUTS

    recording = open_recording(path)
    frame = recording.read(0)
    first: dict[str, Any] = {"name": frame.name, "points": len(frame.points)}
    for name in ("intensity", "ring", "column", "time_s"):
        values = getattr(frame, name)
        if values is not None:
            first[name] = [round(float(one), 6) for one in (np.nanmin(values), np.nanmax(values))]
    if frame.boxes is not None:
        first["boxes"] = dict(Counter(frame.boxes.class_names).most_common())
    return {
        "kind": "recording",
        "layout": LAYOUTS[recording.layout].title,
        "frames": len(recording),
        "first": first,
        "notes": list(recording.notes),
    }


def _without_path(told: Summary) -> dict[str, Any]:
    """Return a summary without its path."""
    return {key: value for key, value in told.items() if key != "path"}


def _yaml(path: Path) -> dict[str, Any]:
    from urbantwin.lidar import load_sensor
    from urbantwin.site import load_rig_spec
    from urbantwin.site.nodes import load_nodes
    from urbantwin.site.yaml_document import read_document

    fields = read_document(path, kind="a site, a rig, nodes or a sensor").value
    if "anchor" in fields:
        return _without_path(Site(path).resolved())
    if "channels" in fields:
        sensor = load_sensor(path)
        return {"kind": "sensor", "name": sensor.name, "channels": sensor.channels}
    if "sensors" in fields:
        return {"kind": "rig", **load_rig_spec(path).written()}
    if "nodes" in fields:
        return {"kind": "nodes", **load_nodes(path).written()}
    raise InputError(
        "is neither a site, a rig, nodes nor a sensor",
        file=path,
        expected="the field anchor, sensors, nodes or channels",
    )


def _extract_or_roads(path: Path, progress: Progress) -> dict[str, Any]:
    from urbantwin.roads.imported import is_map_of_roads

    return _roads(path) if is_map_of_roads(path) else _extract(path, progress)


def _json(path: Path) -> dict[str, Any]:
    from urbantwin.dataset.split import says_split

    if says_split(path):
        from urbantwin.interface.dataset import Datasets

        return {"kind": "split", **Datasets.open(path).summary()}
    return _geometry_or_roads(path)


def _geometry_or_roads(path: Path) -> dict[str, Any]:
    from urbantwin.roads.imported import is_map_of_roads

    return _roads(path) if is_map_of_roads(path) else _geometry(path)


def _roads(path: Path) -> dict[str, Any]:
    from urbantwin.roads.imported import describe_map

    return {"kind": "roads", **describe_map(path)}


def _extract(path: Path, progress: Progress) -> dict[str, Any]:
    from urbantwin.site import read_extract

    extract = read_extract(path, progress=progress)
    longitudes, latitudes = zip(*extract.nodes.values(), strict=True)
    tagged = [way.tags for way in extract.ways.values()]
    tagged += [relation.tags for relation in extract.relations.values()]
    nodes = list(extract.node_tags.values())
    return {
        "kind": "osm",
        "nodes": len(extract.nodes),
        "ways": len(extract.ways),
        "relations": len(extract.relations),
        "highways": len(extract.highways()),
        "signals": sum(tags.get("highway") == "traffic_signals" for tags in nodes),
        "buildings": sum("building" in tags for tags in tagged),
        "trees": sum(tags.get("natural") == "tree" for tags in nodes),
        "bounds_declared": extract.bounds is not None,
        "west": min(longitudes),
        "south": min(latitudes),
        "east": max(longitudes),
        "north": max(latitudes),
    }


#: Largest number of raster cells held at once.
_CELLS = 16_000_000


def _dem(path: Path) -> dict[str, Any]:
    import numpy as np
    from rasterio.windows import Window

    from urbantwin.site.geotiff import opened_geotiff

    with opened_geotiff(path, "a GeoTIFF") as raster:
        rows = max(1, _CELLS // raster.width)  # rows read at once
        low, high, count = np.inf, -np.inf, 0
        for first in range(0, raster.height, rows):
            window = Window(0, first, raster.width, min(rows, raster.height - first))
            read = raster.read(1, window=window, masked=True)
            heights = read.compressed()[np.isfinite(read.compressed())]
            count += len(heights)
            if len(heights):
                low, high = min(low, heights.min()), max(high, heights.max())
        return {
            "kind": "dem",
            "columns": raster.width,
            "rows": raster.height,
            "bands": raster.count,
            "crs": raster.crs.to_string() if raster.crs else None,
            "pixel": [abs(raster.transform.a), abs(raster.transform.e)],
            "bounds": [float(value) for value in raster.bounds],
            "lowest": float(low) if count else None,
            "highest": float(high) if count else None,
            "missing": round(1.0 - count / max(raster.width * raster.height, 1), 4),
        }


def _mesh_or_cloud(path: Path) -> dict[str, Any]:
    """Return a summary of a PLY file: a mesh if its header declares faces (Turk 1994)."""
    import re

    with path.open("rb") as stream:
        head = stream.read(1 << 16).partition(b"end_header")[0]
    has_faces = re.search(rb"^element\s+face\s+[1-9]", head, re.MULTILINE)
    return _geometry(path) if has_faces else _cloud(path)


def _geometry(path: Path) -> dict[str, Any]:
    from urbantwin.reconstruct.describe import describe_geometry

    return describe_geometry(path)


def _cloud(path: Path) -> dict[str, Any]:
    from urbantwin.fidelity.readers.frame_assembly import frame_of
    from urbantwin.io.points import read_fields

    cloud = frame_of(path, read_fields(path), name=path.name)
    told: dict[str, Any] = {
        "kind": "cloud",
        "points": len(cloud.points),
        "intensity": cloud.intensity is not None,
        "lowest": [round(float(value), 3) for value in cloud.points.min(axis=0)],
        "highest": [round(float(value), 3) for value in cloud.points.max(axis=0)],
        "not_finite": cloud.not_finite,
        "no_return": cloud.no_return,
    }
    for name in ("ring", "column"):
        values = getattr(cloud, name)
        if values is not None:
            told[name] = [int(values.min()), int(values.max())]
    return told
