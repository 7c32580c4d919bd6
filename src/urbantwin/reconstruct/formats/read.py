"""Reading a source of geometry with the reader for its file type."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.progress import Progress, between, untold
from urbantwin.reconstruct.formats.citygml import read_citygml
from urbantwin.reconstruct.formats.cityjson import read_cityjson
from urbantwin.reconstruct.formats.colmap import camera_centres, read_sparse_points, sparse_folder
from urbantwin.reconstruct.formats.coordinate_system import crs_of
from urbantwin.reconstruct.formats.e57 import read_e57
from urbantwin.reconstruct.formats.fbx import read_fbx
from urbantwin.reconstruct.formats.file_type import kind_of
from urbantwin.reconstruct.formats.geotagged_images import fitted_places, image_places
from urbantwin.reconstruct.formats.las import read_las
from urbantwin.reconstruct.formats.merging import joined, moved, point_sample
from urbantwin.reconstruct.formats.photogrammetry import model_files
from urbantwin.reconstruct.formats.ply import read_ply
from urbantwin.reconstruct.formats.reality_capture import info_beside, reading_at
from urbantwin.reconstruct.formats.sidecar import placement_beside
from urbantwin.reconstruct.formats.stl import read_stl
from urbantwin.reconstruct.formats.text_points import read_text_points
from urbantwin.reconstruct.formats.texture import beside
from urbantwin.reconstruct.formats.validity import content_of
from urbantwin.reconstruct.formats.wavefront import read_obj
from urbantwin.reconstruct.gltf import read_gltf
from urbantwin.reconstruct.model import ImportedModel, PointCloud
from urbantwin.site import GeometrySource

__all__ = ["read_model"]


def read_model(
    source: GeometrySource,
    frame: SiteFrame,
    region: shapely.Polygon,
    progress: Progress | None = None,
) -> ImportedModel:
    """Read a source: 3D Tiles, a model, a city model, a point cloud or an exported folder.

    Its type is detected by its first bytes, then by its ending, unless ``kind`` is given. Files
    beside a model that say where it is (``sidecar.py``, ``reality_capture.py``) are applied: then
    the model comes in their system.

    Args:
        source: what ``site.yaml`` names.
        frame: the site frame.
        region: the region, site frame: what is read of tiles and of large clouds.
        progress: called with the fraction done (0..1) and what is being done.

    Raises:
        InputError: nothing of it can be read.
    """
    tell = progress or untold
    path, kind = source.path, source.spec.kind
    if path is None or kind == "tiles":
        return _tiles(source, frame, region, tell)
    tell(0.0, "reading")
    if kind == "recording":
        from urbantwin.reconstruct.recording.recorded_world import read_recording

        return read_recording(path, between(tell, 0.0, 0.3))
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
    from urbantwin.reconstruct.tiles3d import read_tiles3d

    return _of_kind(read_tiles3d(source, frame, region, tell), source)


def _file(
    path: Path, source: GeometrySource, frame: SiteFrame, region: shapely.Polygon
) -> ImportedModel:
    """Read one file by what it is."""
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
    """Whether ``site.yaml`` places the coordinates as the file has them."""
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
    """Read a file and apply what files beside it say of its place."""
    model = _file(path, source, frame, region)
    if model.crs is not None or _placed_by_hand(source):
        return model
    info = info_beside(path)
    if info is not None:
        return _by_reality_capture(model, path, source, frame)
    placement = placement_beside(path)
    if placement is None:
        return model
    files = {key: value for file in placement.files for key, value in content_of(file).items()}
    crs = placement.crs if placement.crs is not None else _said_system(source)
    if placement.geotag is None and crs is None and not placement.files:
        return model  # a comment alone, without any system, is too little
    matrix = np.eye(4)
    matrix[:3, 3] = placement.offset
    notes: dict[str, object] = {"placed_by": [file.name for file in placement.files] or "comments"}
    at = moved(model, matrix)
    return replace(
        at,
        crs=placement.crs,
        geotag=placement.geotag if placement.geotag is not None else at.geotag,
        unit_m=1.0 if placement.geotag is not None else at.unit_m,
        notes={**at.notes, **notes},
        files={**at.files, **files},
    )


def _by_reality_capture(
    model: ImportedModel, path: Path, source: GeometrySource, frame: SiteFrame
) -> ImportedModel:
    info = info_beside(path)
    assert info is not None
    files = {**model.files, **content_of(info.path)}
    if info.crs is None and not info.geocentric:
        return replace(model, files=files)
    upright = moved(model, np.eye(4), up="z")
    reading = reading_at(info, point_sample(upright), frame)
    if reading is None:
        name = info.crs.name if info.crs is not None else "EPSG:4978"
        problem = (
            f"{path.name}: no reading of {info.path.name} ({name}) leads to the site; "
            "place it by control points or an origin"
        )
        return replace(model, files=files, problems=(*model.problems, problem))
    matrix, crs = reading
    return replace(
        moved(upright, matrix),
        crs=crs,
        notes={**model.notes, "placed_by": [info.path.name], "system": crs.name},
        files=files,
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
    """Place a COLMAP reconstruction by where its images were taken."""
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
    """Return the model as the kind that ``site.yaml`` asks for.

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
