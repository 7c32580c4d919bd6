"""Reading of 3D Tiles as a model: the tiles that intersect a region, down to a geometric error."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import numpy as np
import shapely
from pyproj import CRS
from pyproj.exceptions import CRSError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.io.gltf.scene import Y_UP_TO_Z_UP, joined_clouds
from urbantwin.io.model import ImportedModel, PointCloud, TriangleMesh
from urbantwin.io.tiles3d.loading import Reading, Traversal
from urbantwin.io.tiles3d.region import (
    Interest,
    is_on_earth,
    site_from_tileset,
)
from urbantwin.io.tiles3d.store import Archive, Folder, Store, TileFiles
from urbantwin.io.tiles3d.tile import ContentLink, Tile, Tileset, Volume, geodetic_from_ecef
from urbantwin.io.tiles3d.tileset import is_tileset, read_tileset
from urbantwin.io.tiles3d.web import open_web
from urbantwin.io.values import MalformedError
from urbantwin.progress import Progress, untold
from urbantwin.site.geometry import GeometrySource

__all__ = ["middle_of_tileset", "read_tiles3d"]

_CONTENT = (b"b3dm", b"i3dm", b"pnts", b"cmpt", b"glTF")

_MOST_PROBLEMS = 200


def read_tiles3d(
    source: GeometrySource,
    frame: SiteFrame,
    region: shapely.Polygon,
    progress: Progress | None = None,
) -> ImportedModel:
    """Read the tiles of a tileset that intersect a region.

    Args:
        source: a ``tileset.json`` (or a folder with one, a ``.3tz``, or a single tile), or its URL.
        frame: the site frame.
        region: region of interest, site frame, metres; tiles are tested against it, but not cut.
        progress: called with the fraction done (0..1) and the current step.

    Returns:
        Meshes and clouds in EPSG:4978 if the tileset is on the ellipsoid; otherwise in the
        tileset's own frame, z up, without a CRS. Objects are named ``"tile / node / feature /
        material"``. Unreadable tiles are lines of ``problems``.

    Source: 3D Tiles 1.1 (OGC 22-025r4) and 1.0 (OGC 18-053r2).

    Raises:
        InputError: nothing can be read, no tile intersects the region, or the source exceeds the
            size limits.
    """
    tell = progress or untold
    store = _opened(source)
    files = TileFiles(store)
    root = _root(source, store, files)
    # An unknown volume does not locate the tileset; its content does, later.
    placed = root.volume.kind != "unknown"
    on_earth = is_on_earth(root.volume) and _may_be_on_earth(source, root.volume)
    to_site = site_from_tileset(source, frame, on_earth=on_earth) if placed else None
    register = source.spec.register_to
    margin = 0.0
    if register is not None:
        west, south, east, north = region.bounds
        margin = register.search_m + float(np.hypot(east - west, north - south))
    interest = Interest(region, frame, to_site, margin)
    traversal = Traversal(files, interest, source.spec.geometric_error_m)
    tell(0.0, "tilesets")
    traversal.start(root)
    reading = Reading(files, interest, traversal, tell)
    reading.run()
    content = reading.content
    told = dict.fromkeys([*traversal.problems, *content.problems])
    problems = [files.hidden(problem) for problem in told]
    mesh = TriangleMesh.concatenate(content.meshes) if content.meshes else None
    cloud = joined_clouds(tuple(content.clouds))
    if mesh is None and cloud is None:
        raise _nothing(source, traversal, problems, on_earth=on_earth)
    if not placed:
        on_earth = on_earth and _lies_on_earth(mesh, cloud)
    notes: dict[str, object] = {
        "tiles that meet the region": len(traversal.tiles),
        "contents read": reading.read,
        "geometric error, m": source.spec.geometric_error_m,
    }
    if reading.filled:
        notes["failed tiles filled from coarser ones"] = reading.filled
    if near := sum(tile.requested_near for tile in traversal.tiles):
        notes["tiles whose viewerRequestVolume was ignored"] = near
    if content.copyright:
        notes["copyright"] = sorted(content.copyright)
    if len(problems) > _MOST_PROBLEMS:
        rest = len(problems) - _MOST_PROBLEMS
        problems = [*problems[:_MOST_PROBLEMS], f"and {rest} more"]
    return ImportedModel(
        mesh=mesh,
        cloud=cloud,
        crs=CRS.from_epsg(4978) if on_earth else None,
        up="z",
        unit_m=1.0,
        problems=tuple(problems),
        notes=notes,
        files=dict(sorted(files.digests.items())),
    )


def middle_of_tileset(source: GeometrySource) -> tuple[float, float] | None:
    """Return latitude and longitude (degrees) of a tileset's centre; ``None`` if it is local.

    Raises:
        InputError: it cannot be read.
    """
    store = _opened(source)
    root = _root(source, store, TileFiles(store))
    if root.volume.kind not in ("region", "box", "sphere") or not is_on_earth(root.volume):
        return None
    v = root.volume.values
    if root.volume.kind == "region":
        lon, lat = (v[0] + v[2]) / 2, (v[1] + v[3]) / 2
    else:
        lon, lat, _ = geodetic_from_ecef(v[None, :3])[0]
    return float(np.degrees(lat)), float(np.degrees(lon))


def _opened(source: GeometrySource) -> Store:
    """Return the store of a source."""
    path = source.path
    if path is None:
        return open_web(source)
    if path.is_dir():
        path = path / "tileset.json"
    if not path.is_file():
        raise InputError("not found", file=path, expected="a tileset.json")
    with path.open("rb") as file:
        packed = file.read(4) == b"PK\x03\x04"
    return Archive(path) if packed else Folder(path)


def _root(source: GeometrySource, store: Store, files: TileFiles) -> Tile:
    """Return the root tile of a tileset, or a root for a source that is a single tile."""
    name = _name(source)
    try:
        data = files.read(store.root)
        if is_tileset(data) or data[:4] not in _CONTENT:
            return read_tileset(data, store.root, None)
    except MalformedError as error:
        raise InputError(files.hidden(str(error)), file=name, expected="3D Tiles") from None
    tileset = Tileset(store.root, Y_UP_TO_Z_UP, (store.root,))
    last = store.root
    if source.path is None:
        last = unquote(urlsplit(last).path.rpartition("/")[2])
    # A single tile is located by its own coordinates, with its centre.
    return Tile(
        None,
        tileset,
        Volume("unknown", np.zeros(0)),
        np.eye(4),
        0.0,
        True,
        (ContentLink(quote(last)),),
        None,
        0,
    )


def _lies_on_earth(mesh: TriangleMesh | None, cloud: PointCloud | None) -> bool:
    """Return whether vertices have about the Earth's radius as distance from their origin."""
    points = np.zeros((0, 3)) if mesh is None else mesh.vertices
    if cloud is not None:
        points = np.concatenate([points, cloud.points])
    middle = np.median(points, axis=0)
    return bool(abs(np.linalg.norm(middle) - 6.367e6) < 60_000.0)


def _name(source: GeometrySource) -> str | Path:
    """Return the name of a source in errors: its file, or its URL without credentials."""
    return re.sub(r"//[^/@]*@", "//", source.name) if source.path is None else source.path


def _may_be_on_earth(source: GeometrySource, volume: Volume) -> bool:
    """Return whether the settings allow Earth-centred coordinates."""
    spec = source.spec
    if spec.origin is not None or spec.control_points is not None or spec.similarity is not None:
        return False
    if spec.crs is None or volume.kind in ("region", "cell"):
        return True
    try:
        return bool(CRS.from_user_input(spec.crs).is_geocentric)
    except CRSError:
        return False


def _nothing(
    source: GeometrySource, traversal: Traversal, problems: list[str], *, on_earth: bool
) -> InputError:
    """Return the error of a tileset without any content read."""
    path = source.path
    name: str | Path = source.name if path is None else path
    if problems:
        more = f" (and {len(problems) - 1} more problems)" if len(problems) > 1 else ""
        return InputError(f"nothing of it can be read: {problems[0]}{more}", file=name)
    if not traversal.tiles:
        where = "its bounding volume lies elsewhere" if on_earth else "by the crs or origin given"
        return InputError(
            f"no tile of it meets the region: {where}", file=name, expected="tiles of the site"
        )
    return InputError(
        "no tile of it that meets the region has a surface or points",
        file=name,
        expected="tiles of the site",
    )
