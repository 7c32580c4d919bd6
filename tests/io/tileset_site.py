"""A site, and tilesets written for it."""

import json
import math
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import shapely

from urbantwin.download import keys_allowed
from urbantwin.geometry import SiteFrame
from urbantwin.io.model import ImportedModel
from urbantwin.io.tiles3d import read_tiles3d
from urbantwin.site.geometry import GeometrySource, GeometrySpec
from urbantwin.site.yaml_document import Document

LATITUDE, LONGITUDE = 40.0425, -75.6121
FRAME = SiteFrame(LATITUDE, LONGITUDE)
REGION = shapely.box(-50, -50, 50, 50)


def east_north_up() -> np.ndarray:
    """ECEF from east, north, up at the site's anchor (closed formulas, WGS84)."""
    lat, lon = math.radians(LATITUDE), math.radians(LONGITUDE)
    a, e2 = 6378137.0, 0.00669437999014
    n = a / math.sqrt(1 - e2 * math.sin(lat) ** 2)
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    result = np.eye(4)
    result[:3, :3] = np.column_stack([east, np.cross(up, east), up])
    result[:3, 3] = n * up * [1, 1, 1 - e2]
    return result


def source(file: Path | str, **spec) -> GeometrySource:
    """A source as site.yaml names it, by its file or address."""
    folder = file.parent if isinstance(file, Path) else Path("/nowhere")
    named = {"file": file.name} if isinstance(file, Path) else {"url": file}
    return GeometrySource(GeometrySpec(**named, **spec), Document(folder / "site.yaml", {}), 0)


def read(file: Path | str, region=REGION, frame: SiteFrame = FRAME, **spec) -> ImportedModel:
    allowed = [f"{name}={urlsplit(str(file)).scheme}://{urlsplit(str(file)).netloc}"
               for name in [spec.get("key_env")] if name]  # fmt: skip
    with keys_allowed(None, allowed):
        return read_tiles3d(source(file, **spec), frame, region)


def tile(error: float, x0, y0, x1, y1, **more) -> dict:
    """A tile whose box spans x0..x1, y0..y1 and 0..20 m."""
    middle, half = [(x0 + x1) / 2, (y0 + y1) / 2, 10], [(x1 - x0) / 2, (y1 - y0) / 2, 10]
    box = [*middle, half[0], 0, 0, 0, half[1], 0, 0, 0, half[2]]
    return {"boundingVolume": {"box": box}, "geometricError": error, **more}


def write(folder: Path, root: dict, files: dict[str, bytes], name: str = "tileset.json") -> Path:
    """Write a tileset that stands at the anchor."""
    place = east_north_up().T.reshape(-1).tolist()
    document = {"asset": {"version": "1.1"}, "geometricError": 500}
    document["root"] = {**root, "transform": place}
    for path, data in {name: json.dumps(document).encode(), **files}.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(data)
    return folder / name


def on_site(points: np.ndarray) -> np.ndarray:
    """Points of EPSG:4978 in the tangent plane at the anchor."""
    to_ecef = east_north_up()
    return (points - to_ecef[:3, 3]) @ to_ecef[:3, :3]


def names(model: ImportedModel) -> set[str]:
    """Names of the tiles of which there are triangles."""
    assert model.mesh is not None
    return {model.mesh.names[k].split(" / ")[0] for k in np.unique(model.mesh.object)}
