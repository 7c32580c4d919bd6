"""A place as public sources would have it, made: every value in it follows from a formula."""

import io
import json
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import rasterio
import rasterio.shutil
import shapely
import yaml
from affine import Affine
from PIL import Image
from pyproj import CRS, Transformer

from .local_web import Web, known_place, nominatim, overpass
from .octree_files import as_copc, as_ept

ROOT = Path(__file__).parents[2]
EXTRACT = ROOT / "examples" / "two-avenues" / "two-avenues.osm"
#: The junction of the extract.
LATITUDE, LONGITUDE = 48.70, 9.18
RD = CRS.from_user_input("EPSG:25832+5783")
ZOOM = 16


def height(longitude: np.ndarray, latitude: np.ndarray) -> np.ndarray:
    """The bare earth: a plane, which bilinear resampling keeps."""
    return (
        250.0
        + 4000.0 * (np.asarray(latitude) - LATITUDE)
        + 2000.0 * (np.asarray(longitude) - LONGITUDE)
    )


def cog(west: float, south: float, side: float, cells: int, fine: float = 0.0) -> bytes:
    """A cloud-optimised GeoTIFF of that plane over a square of degrees, ``fine`` metres higher."""
    step = side / cells
    across = west + (np.arange(cells) + 0.5) * step
    down = south + side - (np.arange(cells) + 0.5) * step
    values = (height(*np.meshgrid(across, down)) + fine).astype(np.float32)
    # Noise in the last bits, which no packing takes away: blocks are large, as real ones.
    noise = np.random.default_rng(1).integers(0, 64, values.shape, np.uint32)
    values.view(np.uint32)[...] += noise
    profile = {
        "driver": "GTiff", "dtype": "float32", "count": 1, "width": cells, "height": cells,
        "crs": "EPSG:4326", "transform": Affine(step, 0, west, 0, -step, south + side),
        "nodata": -9999.0,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        plain, tiled = Path(folder) / "plain.tif", Path(folder) / "cog.tif"
        with rasterio.open(plain, "w", **profile) as out:
            out.write(values, 1)
        with rasterio.open(plain) as source:
            rasterio.shutil.copy(source, tiled, driver="COG", compress="deflate", blocksize=256)
        return tiled.read_bytes()


def survey(half_m: float = 400.0, step_m: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Points of the plane and of a block on it 10 m high, in metres of `RD`, and their classes."""
    to = Transformer.from_crs("EPSG:4326", 25832, always_xy=True)
    x0, y0 = to.transform(LONGITUDE, LATITUDE)
    axis = np.arange(-half_m, half_m, step_m)
    x, y = (one.ravel() for one in np.meshgrid(x0 + axis, y0 + axis))
    z = height(*to.transform(x, y, direction="INVERSE"))
    block = (np.abs(x - x0 - 60) < 10) & (np.abs(y - y0 - 60) < 10)
    return np.column_stack([x, y, z + 10.0 * block]), np.where(block, 6, 2)


def footprint(east_m: float, north_m: float, side_m: float = 12.0) -> shapely.Polygon:
    """A square so far from the junction, longitude and latitude."""
    per_deg = 111_195.0
    half = side_m / 2 / per_deg
    stretch = 1 / np.cos(np.radians(LATITUDE))
    x, y = LONGITUDE + east_m / per_deg * stretch, LATITUDE + north_m / per_deg
    return shapely.box(x - half * stretch, y - half, x + half * stretch, y + half)


def parquet(shapes: list[shapely.Geometry], heights: list[float | None], group: int = 100) -> bytes:
    """Buildings as Overture has them (GeoParquet 1.1 with a column bbox)."""
    bounds = np.array([one.bounds for one in shapes], np.float32).reshape(-1, 4)
    table = pa.table({
        "id": [f"made-{k:05}" for k in range(len(shapes))],
        "geometry": [shapely.to_wkb(one) for one in shapes],
        "bbox": pa.StructArray.from_arrays(
            [pa.array(column) for column in bounds.T], ["xmin", "ymin", "xmax", "ymax"]),
        "height": pa.array(heights, pa.float64()),
        "num_floors": pa.array([None] * len(shapes), pa.int32()),
        "class": pa.array([None] * len(shapes), pa.string()),
        "roof_shape": pa.array(["flat"] * len(shapes)),
        "is_underground": pa.array([False] * len(shapes)),
        "names": [f"a long text that nobody needs {k} " * 20 for k in range(len(shapes))],
    })  # fmt: skip
    out = io.BytesIO()
    pq.write_table(table, out, row_group_size=group, compression="zstd")
    return out.getvalue()


def catalogue(release: str, files: dict[str, tuple[float, float, float, float]]) -> bytes:
    """Overture's list of files, ``collections.parquet``: each with its box."""
    rows = [
        {"collection": "building", "type": "Feature",
         "bbox": dict(zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True)),
         "assets": {"aws": {"href": url, "type": "application/vnd.apache.parquet"}}}
        for url, box in files.items()
    ]  # fmt: skip
    out = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows), out)
    return out.getvalue()


def picture(x: int, y: int) -> bytes:
    """A tile whose colour tells which it is."""
    out = io.BytesIO()
    Image.new("RGB", (256, 256), (x % 256, y % 256, 90)).save(out, "PNG")
    return out.getvalue()


def terrain(x: int, y: int, zoom: int) -> bytes:
    """A terrain tile (Terrarium) of the plane."""
    count = 256 << zoom
    columns = (x * 256 + np.arange(256) + 0.5) / count
    rows = (y * 256 + np.arange(256) + 0.5) / count
    latitude = np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * rows))))
    values = height(*np.meshgrid(columns * 360 - 180, latitude)) + 32768
    bands = [values // 256, np.floor(values) % 256, (values * 256) % 256]
    out = io.BytesIO()
    Image.fromarray(np.stack(bands, axis=2).astype(np.uint8)).save(out, "PNG")
    return out.getvalue()


def world(web: Web) -> None:
    """Let a server have all of the place."""
    web.answers["/api/interpreter"] = overpass(EXTRACT.read_bytes())
    web.answers["/search"] = nominatim(
        {"stuttgart": [known_place(LATITUDE, LONGITUDE, "Stuttgart")]}
    )
    # Tiles of a degree are large: four blocks of 256 cells a side, of which one is needed.
    web.files["/dem/N48E009.tif"] = cog(9.0, 48.0, 1.0, 1024)
    web.files["/survey.copc.laz"] = as_copc(*survey(), RD)
    web.files |= {f"/ept/{name}": data for name, data in as_ept(*survey(), RD).items()}
    near = [footprint(0.0, -40.0 * k) for k in range(-2, 3)]
    far = [footprint(20_000.0 + 40 * k, 9000.0) for k in range(400)]
    web.files["/overture/one.parquet"] = parquet([*far, *near], [12.5] * 405)
    web.files["/stac/catalog.json"] = json.dumps({"latest": "2026-10-21.0"}).encode()
    web.files["/stac/2026-10-21.0/collections.parquet"] = catalogue(
        "2026-10-21.0",
        {f"{web.url}/overture/one.parquet": (9.0, 48.0, 10.0, 49.0),
         f"{web.url}/overture/other.parquet": (-10.0, 10.0, 0.0, 20.0)},
    )  # fmt: skip


def row(
    web: Web, name: str, kind: str, access: str, path: str | None = None, **more: object
) -> dict:
    """A row of a table of sources."""
    address = {} if path is None else {"url": web.url + path}
    terms = {"licence": f"licence of {name}", "attribution": f"makers of {name}"}
    return {"name": name, "title": name, "kind": kind, "access": access, **address, **terms, **more}


def table(folder: Path, *rows: dict) -> Path:
    path = folder / "own-sources.yaml"
    path.write_text(yaml.safe_dump({"sources": list(rows)}))
    return path
