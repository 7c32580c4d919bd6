"""What a file or a folder holds, in a few values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from urbantwin.artefact import read_json
from urbantwin.errors import InputError
from urbantwin.progress import Progress, untold

__all__ = ["summary"]

MANIFESTS = ("twin", "motion", "dataset", "report", "coverage")
CLOUDS = (".npy", ".bin", ".pcd", ".ply")
EXPECTED = (
    "a twin, motion, dataset, report or coverage; a site.yaml, rig.yaml or sensor; an "
    "OpenStreetMap extract (.osm, .osm.bz2, .osm.gz, .osm.pbf), a map of the roads (.xodr, "
    "Lanelet2 .osm), a DEM (.tif), a cloud (.npy, .bin, .pcd, .ply) or geometry (.glb, .gltf, "
    ".obj, .ply, .stl, .fbx, .las, .laz, CityJSON, tileset.json, .3tz, a folder of photogrammetry)"
)
GEOMETRY = (
    *(".glb", ".gltf", ".obj", ".stl", ".fbx", ".las", ".laz", ".json", ".jsonl", ".cityjson"),
    *(".3tz", ".b3dm", ".i3dm", ".pnts", ".cmpt", ".xyz", ".pts"),
)


def summary(path: Path, progress: Progress = untold) -> dict[str, Any]:
    """Return what ``path`` holds: its kind first, then values that JSON can hold.

    Args:
        path: a file or a folder.
        progress: told the share done (0..1) of reading a large map.

    Raises:
        InputError: it is missing, damaged, or nothing that UrbanTwin knows.
    """
    if not path.exists():
        raise InputError("not found", file=path, expected=EXPECTED)
    describe = _folder if path.is_dir() else _by_ending(path.name.lower(), progress)
    if describe is None:
        raise InputError("is nothing that UrbanTwin knows", file=path, expected=EXPECTED)
    return {"path": str(path), **describe(path)}


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
        ((".json",), _geometry_or_roads),
        (GEOMETRY, _geometry),
    ):
        if name.endswith(endings):
            return describe
    return None


def _folder(folder: Path) -> dict[str, Any]:
    for kind in MANIFESTS:
        if (folder / f"{kind}.json").is_file():
            return _ARTEFACTS[kind](folder)
    parts = {kind: _folder(folder / kind) for kind in MANIFESTS if (folder / kind).is_dir()}
    if parts:
        return {"kind": "run", **parts}
    if (folder / "site.yaml").is_file():
        return _yaml(folder / "site.yaml")
    from urbantwin.fidelity.clouds import cloud_files

    clouds = [path for path in folder.iterdir() if path.suffix.lower() in CLOUDS]
    if (folder / "tileset.json").is_file() or not clouds:
        from urbantwin.reconstruct.formats import holds_model

        if (folder / "tileset.json").is_file() or holds_model(folder):
            return _geometry(folder)
        raise InputError("holds nothing that UrbanTwin knows", file=folder, expected=EXPECTED)
    return {
        "kind": "clouds",
        "frames": len(cloud_files(folder)),
        "first": _cloud(cloud_files(folder)[0]),
    }


def _twin(folder: Path) -> dict[str, Any]:
    from collections import Counter

    from urbantwin.roads.signals.programs import described_signals
    from urbantwin.taxonomy import semantic_classes
    from urbantwin.twin import load_twin

    twin = load_twin(folder)
    names = {entry.id: entry.name for entry in semantic_classes().values()}
    triangles = Counter(names[int(number)] for number in twin.mesh.semantic)
    return {
        "kind": "twin",
        "name": twin.manifest["name"],
        "made_with": f"urbantwin {twin.manifest['version']}",
        "latitude": twin.frame.latitude,
        "longitude": twin.frame.longitude,
        "region_m2": round(twin.region.area, 1),
        "driving_side": twin.manifest["driving_side"],
        "triangles": len(twin.mesh.faces),
        "triangles_by_class": dict(triangles.most_common()),
        "signals": described_signals(twin.net_path),
        "notes": twin.manifest["notes"],
        "inputs": [
            {key: item[key] for key in ("name", "licence", "attribution")}
            for item in twin.manifest["inputs"]
        ],
    }


def _motion(folder: Path) -> dict[str, Any]:
    from urbantwin.traffic import describe

    return describe(folder)


def _dataset(folder: Path) -> dict[str, Any]:
    from urbantwin.dataset import describe

    return describe(folder)


def _coverage(folder: Path) -> dict[str, Any]:
    return read_json(folder / "coverage.json", kind="coverage")


def _scores(protocol: dict[str, Any] | None) -> dict[str, Any] | None:
    if not protocol:
        return None
    return {
        name: {
            part: round(row[part], 4)
            for part in ("combined", "detection", "realism")
            if row[part] is not None
        }
        for name, row in protocol["scores"].items()
    }


def _report(folder: Path) -> dict[str, Any]:
    manifest = read_json(folder / "report.json", kind="report")
    try:
        anchors = manifest["anchors"]
        columns = {
            "synthetic": manifest["aggregate"],
            "next_real": anchors["real_against_real"],
            "arbitrary": anchors["arbitrary"],
        }
        return {
            "kind": "report",
            "in_short": manifest.get("in_short"),
            "doubts": manifest.get("doubts", []),
            "folders": manifest["folders"],
            "frames": len(manifest["frames"]),
            "mean_over_frames": {
                measure: {
                    name: round(column[measure]["mean"], 4)
                    for name, column in columns.items()
                    if column and column.get(measure)
                }
                for measure in manifest["definitions"]
            },
            "reduction_percent": _rounded(anchors["reduction_percent"], 1),
            "ratio_to_real": _rounded(anchors.get("ratio_to_real"), 2),
            "parts": {
                part: _rounded({measure: row["twin"] for measure, row in rows.items()}, 4)
                for part, rows in manifest.get("headline", {}).items()
                if part != "whole"
            },
            "protocol": _scores(manifest.get("protocol")),
            "problems": manifest.get("problems", []),
            "notes": manifest["notes"],
        }
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"lacks {error}", file=folder / "report.json", expected="a report's figures"
        ) from None


def _rounded(
    values: Mapping[str, float | None] | None, digits: int
) -> dict[str, float | None] | None:
    """Return values to print; ``report.json`` has all their digits."""
    if values is None:
        return None
    return {name: None if value is None else round(value, digits) for name, value in values.items()}


def _yaml(path: Path) -> dict[str, Any]:
    from urbantwin.lidar import load_sensor
    from urbantwin.site import load_rig_spec, load_site
    from urbantwin.site.yaml_document import read_document

    fields = read_document(path, kind="a site, a rig or a sensor").value
    if "anchor" in fields:
        site = load_site(path)
        resolved = site.resolved()
        resolved["region"] = {"area_m2": round(site.region.area, 1)}
        return {"kind": "site", **resolved, "inputs": site.inputs()}
    if "channels" in fields:
        sensor = load_sensor(path)
        return {"kind": "sensor", "name": sensor.name, "channels": sensor.channels}
    if "sensors" in fields:
        return {"kind": "rig", **load_rig_spec(path).written()}
    raise InputError(
        "is neither a site, a rig nor a sensor",
        file=path,
        expected="the field anchor, sensors or channels",
    )


def _extract_or_roads(path: Path, progress: Progress) -> dict[str, Any]:
    from urbantwin.roads.imported import is_map_of_roads

    return _roads(path) if is_map_of_roads(path) else _extract(path, progress)


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


#: Cells of a raster that are held at once.
_CELLS = 16_000_000


def _dem(path: Path) -> dict[str, Any]:
    import numpy as np
    from rasterio.windows import Window

    from urbantwin.site.geotiff import opened_geotiff

    with opened_geotiff(path, "a GeoTIFF") as raster:
        rows = max(1, _CELLS // raster.width)  # read at once
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
    """Describe a PLY: a mesh if its header declares faces (Turk 1994)."""
    import re

    with path.open("rb") as stream:
        head = stream.read(1 << 16).partition(b"end_header")[0]
    has_faces = re.search(rb"^element\s+face\s+[1-9]", head, re.MULTILINE)
    return _geometry(path) if has_faces else _cloud(path)


def _geometry(path: Path) -> dict[str, Any]:
    from urbantwin.reconstruct.describe import describe_geometry

    return describe_geometry(path)


def _cloud(path: Path) -> dict[str, Any]:
    from urbantwin.fidelity.clouds import read_cloud

    cloud = read_cloud(path)
    return {
        "kind": "cloud",
        "points": len(cloud.points),
        "intensity": cloud.intensity is not None,
        "lowest": [round(float(value), 3) for value in cloud.points.min(axis=0)],
        "highest": [round(float(value), 3) for value in cloud.points.max(axis=0)],
        "not_finite": cloud.not_finite,
        "no_return": cloud.no_return,
    }


_ARTEFACTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "twin": _twin,
    "motion": _motion,
    "dataset": _dataset,
    "report": _report,
    "coverage": _coverage,
}
