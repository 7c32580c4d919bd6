"""Reading a source of geometry with the reader for its file type."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.io.cities.citygml import read_citygml
from urbantwin.io.cities.cityjson import read_cityjson
from urbantwin.io.colmap import (
    camera_centres,
    fitted_places,
    image_places,
    read_sparse_points,
    sparse_folder,
)
from urbantwin.io.e57 import read_e57
from urbantwin.io.fbx import read_fbx
from urbantwin.io.gltf import read_gltf
from urbantwin.io.kinds import kind_of, model_files
from urbantwin.io.las import read_las
from urbantwin.io.model import ImportedModel, PointCloud, TriangleMesh
from urbantwin.io.obj import read_obj
from urbantwin.io.placement import placement_beside
from urbantwin.io.ply import read_ply, read_stl
from urbantwin.io.systems import crs_of
from urbantwin.io.text import read_text_points
from urbantwin.io.texture import beside
from urbantwin.io.trust import content_of
from urbantwin.progress import Progress, untold
from urbantwin.site import GeometrySource

__all__ = ["read_model"]


def read_model(
    source: GeometrySource,
    frame: SiteFrame,
    region: shapely.Polygon,
    progress: Progress | None = None,
) -> ImportedModel:
    """Read a source: 3D Tiles, a model, a city model, a point cloud or an exported folder.

    Its type is detected by its first bytes, then by its suffix, unless ``kind`` is given. An offset
    and a CRS in files beside a model (``placement.py``) are applied.

    Args:
        source: a source of ``site.yaml``.
        frame: the site frame.
        region: the region, site frame, to which tiles and large clouds are limited.
        progress: called with the fraction done (0..1) and the current step.

    Raises:
        InputError: nothing can be read.
    """
    tell = progress or untold
    path, kind = source.path, source.spec.kind
    if path is None or kind == "tiles":
        return _tiles(source, frame, region, tell)
    tell(0.0, "reading")
    if path.is_dir():
        if (path / "tileset.json").is_file() and kind in ("auto", "mesh"):
            spec = source.spec.model_copy(update={"file": f"{source.spec.file}/tileset.json"})
            return _tiles(replace(source, spec=spec), frame, region, tell)
        return _of_kind(_folder(path, source, frame, region, tell), source)
    if kind_of(path) == "tiles":
        return _tiles(source, frame, region, tell)
    return _of_kind(_placed_by_files(path, source, frame, region), source)


def _tiles(
    source: GeometrySource, frame: SiteFrame, region: shapely.Polygon, tell: Progress
) -> ImportedModel:
    from urbantwin.io.tiles3d import read_tiles3d

    return _of_kind(read_tiles3d(source, frame, region, tell), source)


def _file(
    path: Path, source: GeometrySource, frame: SiteFrame, region: shapely.Polygon
) -> ImportedModel:
    """Read a file by its format."""
    spec = source.spec
    kind = "cityjson" if spec.kind == "cityjson" and path.is_file() else kind_of(path)
    readers: dict[str, Callable[[Path], ImportedModel]] = {
        "obj": read_obj,
        "ply": read_ply,
        "stl": read_stl,
        "fbx": read_fbx,
        "cityjson": read_cityjson,
        "citygml": read_citygml,
        "points": read_text_points,
        "gltf": _gltf,
    }
    if kind in ("las", "e57"):
        read_cloud = read_las if kind == "las" else read_e57
        crop = not _placed_by_hand(source)
        return read_cloud(path, frame, region, _said_system(source), crop=crop)
    if kind not in readers:
        raise InputError("is a tileset", file=path, expected="a model")
    return readers[kind](path)


def _placed_by_hand(source: GeometrySource) -> bool:
    """Return whether ``site.yaml`` places the file's own coordinates."""
    spec = source.spec
    return any(one is not None for one in (spec.control_points, spec.similarity, spec.origin))


def _said_system(source: GeometrySource) -> CRS | None:
    return None if source.spec.crs is None else crs_of(source.spec.crs)


def _gltf(path: Path) -> ImportedModel:
    files = content_of(path)

    def resolve(uri: str) -> bytes:
        found = beside(path.parent, unquote(uri))
        if found is None:
            raise InputError(f"names {uri[:60]!r}, which is not beside it", file=path)
        files.update(content_of(found))
        return found.read_bytes()

    model = read_gltf(path.read_bytes(), resolve, name=str(path))
    named = {Path(name).name: value for name, value in model.files.items()}
    return replace(model, files={**files, **named})


def _placed_by_files(
    path: Path, source: GeometrySource, frame: SiteFrame, region: shapely.Polygon
) -> ImportedModel:
    """Read a file and apply the offset and CRS in files beside it."""
    model = _file(path, source, frame, region)
    if model.crs is not None or _placed_by_hand(source):
        return model
    placement = placement_beside(path)
    if placement is None:
        return model
    crs = placement.crs if placement.crs is not None else _said_system(source)
    if crs is None and not placement.files:
        return model  # a comment without any CRS is insufficient
    matrix = np.eye(4)
    matrix[:3, 3] = placement.offset
    placed = moved(model, matrix)
    return replace(
        placed,
        crs=placement.crs,
        notes={
            **placed.notes,
            "placed_by": [file.name for file in placement.files] or "comments",
        },
        files={
            **placed.files,
            **{key: value for file in placement.files for key, value in content_of(file).items()},
        },
    )


def _folder(
    folder: Path,
    source: GeometrySource,
    frame: SiteFrame,
    region: shapely.Polygon,
    tell: Progress,
) -> ImportedModel:
    """Read the model of an exported folder, all of its parts."""
    sparse = sparse_folder(folder)
    files = model_files(folder)
    models: list[ImportedModel] = []
    problems: list[str] = []
    for number, file in enumerate(files):
        tell(number / len(files), f"reading {file.name}")
        try:
            models.append(_placed_by_files(file, source, frame, region))
        except InputError as error:
            if len(files) == 1:
                raise
            problems.append(str(error))
    if not files:
        assert sparse is not None
        models.append(read_sparse_points(sparse))
    if not models:
        raise InputError(
            f"holds {len(files)} parts, none of which can be read ({problems[0]})",
            file=folder,
            expected="at least one that can",
        )
    model = joined(models, problems)
    known = model.crs is not None or model.geotag is not None
    if sparse is None or known or _placed_by_hand(source):
        return model
    return _by_images(model, folder, sparse)


def _by_images(model: ImportedModel, folder: Path, sparse: Path) -> ImportedModel:
    """Georeference a COLMAP reconstruction by the positions of its images."""
    points = point_sample(model)
    if 6.2e6 < np.linalg.norm(np.median(points, axis=0)) < 6.5e6:
        # model_aligner --alignment_type ecef
        return replace(model, crs=CRS.from_epsg(4978), notes={**model.notes, "placed_by": "ECEF"})
    centres = camera_centres(sparse)
    places = image_places(folder, list(centres))
    fit = None if places is None else fitted_places(centres, places)
    if fit is None:
        why = "their images have no places" if places is None else "their images stand in a line"
        return replace(model, problems=(*model.problems, f"{folder.name}: not placed: {why}"))
    matrix, tag, notes = fit
    at = moved(model, matrix)
    return replace(at, up="z", unit_m=1.0, geotag=tag, notes={**at.notes, **notes})


def _of_kind(model: ImportedModel, source: GeometrySource) -> ImportedModel:
    """Return the model as the kind requested in ``site.yaml``.

    Raises:
        InputError: it is of another kind.
    """
    kind = source.spec.kind
    if kind == "cloud" and model.cloud is None and model.mesh is not None:
        used: NDArray[np.int32] = np.unique(model.mesh.faces)
        cloud = PointCloud(model.mesh.vertices[used])
        return replace(model, mesh=None, cloud=cloud)
    if kind in ("mesh", "cityjson") and model.mesh is None:
        raise InputError(
            "is a point cloud", file=source.path, expected=f"a mesh, as {source.place('kind')} says"
        )
    return model


#: y-up to z-up: (x, y, z) becomes (x, -z, y).
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
_SAMPLE = 10_000


def moved(model: ImportedModel, matrix: NDArray[np.float64], up: str | None = "z") -> ImportedModel:
    """Return a model converted to z-up, and then transformed by a matrix (4, 4)."""
    whole = matrix @ _UPRIGHT if model.up == "y" else matrix
    if np.array_equal(whole, np.eye(4)):
        return replace(model, up=up)
    mesh, cloud = model.mesh, model.cloud
    if mesh is not None:
        mesh = replace(mesh, vertices=mesh.vertices @ whole[:3, :3].T + whole[:3, 3])
        if np.linalg.det(whole[:3, :3]) < 0:
            mesh = replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]))
    if cloud is not None:
        cloud = replace(cloud, points=cloud.points @ whole[:3, :3].T + whole[:3, 3])
    return replace(model, mesh=mesh, cloud=cloud, up=up)


def point_sample(model: ImportedModel) -> NDArray[np.float64]:
    """Return a sample of a model's points, evenly through its file."""
    points = model.mesh.vertices if model.mesh is not None else None
    if points is None:
        assert model.cloud is not None
        points = model.cloud.points
    return points[:: max(1, len(points) // _SAMPLE)]


def joined(models: Sequence[ImportedModel], problems: Sequence[str] = ()) -> ImportedModel:
    """Return the parts of one model as one.

    Raises:
        InputError: they have different CRS, axes, units or geotags.
    """
    if len(models) == 1:
        return replace(models[0], problems=(*models[0].problems, *problems))
    first = models[0]
    for other in models[1:]:
        if (other.crs, other.up, other.unit_m) != (first.crs, first.up, first.unit_m):
            names = f"{next(iter(first.files), '?')} and {next(iter(other.files), '?')}"
            raise InputError(f"parts {names} are in different systems", expected="one system")
        if other.geotag != first.geotag:
            raise InputError("parts have different geotags", expected="one geotag")
    meshes = [model.mesh for model in models if model.mesh is not None]
    clouds = [model.cloud for model in models if model.cloud is not None]
    return replace(
        first,
        mesh=TriangleMesh.concatenate(meshes) if meshes else None,
        cloud=PointCloud.concatenate(clouds) if clouds else None,
        problems=(*(text for model in models for text in model.problems), *problems),
        notes={"parts": len(models), **_summed([model.notes for model in models])},
        files={name: value for model in models for name, value in model.files.items()},
    )


def _summed(notes: Sequence[dict[str, object]]) -> dict[str, object]:
    """Return the sums of counts of parts; of other notes the first is kept."""
    total: dict[str, object] = {}
    for one in notes:
        for key, value in one.items():
            known = total.get(key)
            if isinstance(value, int) and isinstance(known, int):
                total[key] = known + value
            elif isinstance(value, dict) and isinstance(known, dict):
                total[key] = dict(sorted(_summed([known, value]).items()))
            elif known is None:
                total[key] = value
    return total
