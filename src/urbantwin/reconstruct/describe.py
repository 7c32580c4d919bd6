"""Summary of a file or folder of geometry, without a site."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from urbantwin.artefact import as_json
from urbantwin.geometry import SiteFrame
from urbantwin.io import read_model
from urbantwin.io.kinds import kind_of
from urbantwin.io.model import ImportedModel
from urbantwin.io.tiles3d import middle_of_tileset
from urbantwin.reconstruct.georeference.axes import axes_of
from urbantwin.site import GeometrySource
from urbantwin.site.geometry import GeometrySpec, SimilaritySpec
from urbantwin.site.yaml_document import Document

__all__ = ["describe_geometry"]

#: Radius around the centre of a tileset that is read, metres.
_AROUND_M = 500.0
#: Maximum number of names and problems listed.
_MOST = 8
_DEGREES = CRS.from_epsg(4979)
_NOT_SAID = "not said"
_NOWHERE = SiteFrame(0.0, 0.0)


def describe_geometry(path: Path) -> dict[str, Any]:
    """Return a summary of a source of geometry.

    Args:
        path: a mesh, a ``tileset.json``, a city model, a point cloud, or a folder of one of them.

    Returns:
        ``kind``; ``triangles`` or ``points``, ``objects`` and some of their names. ``lowest`` and
        ``highest`` corner are in its own coordinates (longitude, latitude and ellipsoidal height
        if those are Earth-centred). Further: ``crs``, ``latitude`` and ``longitude`` of its centre
        if georeferenced, ``up`` and ``unit_m`` with their source, and ``problems``.

    Raises:
        InputError: nothing can be read.
    """
    kind = _kind(path)
    spec = GeometrySpec(file=path.name)
    frame, region = _NOWHERE, shapely.box(-_AROUND_M, -_AROUND_M, _AROUND_M, _AROUND_M)
    if kind == "las":  # as if placed by hand, so that it is read in full
        spec = spec.model_copy(update={"similarity": SimilaritySpec()})
    source = GeometrySource(spec, Document(path, {}), 0)
    if kind == "tiles":
        middle = middle_of_tileset(source)
        if middle is not None:
            frame = SiteFrame(*middle)
        else:
            region = shapely.box(-1e6, -1e6, 1e6, 1e6)
            spec = spec.model_copy(update={"similarity": SimilaritySpec()})
            source = replace(source, spec=spec)
    model = read_model(source, frame, region)
    out: dict[str, Any] = {"kind": "geometry", "format": kind, **_counts(model)}
    points = _points(model)
    if model.crs is not None and model.crs.is_geocentric:
        to_degrees = Transformer.from_crs(model.crs, _DEGREES, always_xy=True)
        points = np.column_stack(to_degrees.transform(points[:, 0], points[:, 1], points[:, 2]))
    if kind == "tiles" and model.crs is not None:
        out["read"] = f"within {_AROUND_M:g} m of its middle"
    if len(points):
        digits = (
            7
            if model.crs is not None and (model.crs.is_geocentric or model.crs.is_geographic)
            else 3
        )
        out["lowest"] = [round(float(v), digits) for v in points.min(axis=0)]
        out["highest"] = [round(float(v), digits) for v in points.max(axis=0)]
    out |= _place(model, points)
    axes = axes_of(model, source)
    out["up"] = f"{axes.up} ({axes.up_why})"
    out["unit_m"] = f"{axes.unit_m:.9g} ({axes.unit_why})"
    if model.notes:
        out["notes"] = as_json(model.notes)
    out["files"] = len(model.files)
    out["problems"] = list(model.problems[:_MOST])
    if len(model.problems) > _MOST:
        out["further_problems"] = len(model.problems) - _MOST
    return out


def _kind(path: Path) -> str:
    if path.is_dir():
        return "tiles" if (path / "tileset.json").is_file() else "folder"
    return kind_of(path)


def _counts(model: ImportedModel) -> dict[str, Any]:
    out: dict[str, Any] = {}
    if model.mesh is not None:
        used = np.unique(model.mesh.object)
        names = [model.mesh.names[number] for number in used[:_MOST].tolist()]
        out["triangles"] = len(model.mesh.faces)
        out["vertices"] = len(model.mesh.vertices)
        out["objects"] = len(used)
        out["named"] = [name for name in names if name]
        out["coloured"] = model.mesh.colour is not None
    if model.cloud is not None:
        out["points"] = len(model.cloud.points)
        out["coloured"] = model.cloud.colour is not None
        if model.cloud.classification is not None:
            classes, count = np.unique(model.cloud.classification, return_counts=True)
            pairs = zip(classes.tolist(), count.tolist(), strict=True)
            out["points_by_class"] = {f"class {number}": many for number, many in pairs}
    return out


def _points(model: ImportedModel) -> NDArray[np.float64]:
    parts = [np.zeros((0, 3))]
    if model.mesh is not None:
        parts.append(model.mesh.vertices[np.unique(model.mesh.faces)])
    if model.cloud is not None:
        parts.append(model.cloud.points)
    points = np.concatenate(parts)
    return points[np.isfinite(points).all(axis=1)]


def _place(model: ImportedModel, points: NDArray[np.float64]) -> dict[str, Any]:
    """Return the georeference of a model."""
    if model.geotag is not None:
        tag = model.geotag
        return {
            "crs": _NOT_SAID if model.crs is None else model.crs.name,
            "origin": {
                "latitude": round(tag.latitude, 7),
                "longitude": round(tag.longitude, 7),
                "height_m": tag.height_m,
                "heading_deg": round(tag.heading_deg, 3),
            },
        }
    if model.crs is None:
        return {"crs": _NOT_SAID}
    out: dict[str, Any] = {"crs": model.crs.name}
    if len(points):
        x, y, z = ((points.min(axis=0) + points.max(axis=0)) / 2).tolist()
        system = _DEGREES if model.crs.is_geocentric else model.crs
        try:
            to_degrees = Transformer.from_crs(system, _DEGREES, always_xy=True)
            longitude, latitude, _ = to_degrees.transform(x, y, z, errcheck=True)
        except ProjError:
            return out
        if np.isfinite([longitude, latitude]).all():
            out |= {"latitude": round(latitude, 7), "longitude": round(longitude, 7)}
    return out
