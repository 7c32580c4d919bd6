"""Bad files of what people say about a site: maps, regions, documents, rasters, sensors."""

import bz2
import gzip
import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import osmium
import pyogrio
import pytest
import rasterio
import shapely
import yaml
from affine import Affine

from urbantwin.experiments.campaign.file import CampaignFile
from urbantwin.experiments.ladder import CurriculumFile
from urbantwin.experiments.study.file import StudyFile
from urbantwin.experiments.variation.run_file import RunFile
from urbantwin.geometry import SiteFrame
from urbantwin.interface.inspection import summary_of as summary
from urbantwin.lidar import load_scan_pattern, load_sensor
from urbantwin.lidar.sensor_options import check_models
from urbantwin.reconstruct.airborne import read_footprints
from urbantwin.scene.catalogue import street_objects
from urbantwin.site import (
    ImagerySource,
    ImagerySpec,
    check_dem,
    load_rig_spec,
    load_site,
    load_traffic_changes,
    read_extract,
    read_orthophoto,
)
from urbantwin.site.corrections import read_corrections
from urbantwin.site.initial_site import init_site
from urbantwin.site.nodes import load_nodes
from urbantwin.site.region import polygon_from_geojson, polygon_in_site, read_geojson
from urbantwin.site.yaml_document import Document
from urbantwin.studies.placement import load_place_spec
from urbantwin.weakness import check_inputs
from urbantwin.weakness.inputs import look_at_picture

from .harness import NUMBERS
from .reader import SHARED_DATA, Reader

AVENUES = Path(__file__).parents[2] / "examples" / "two-avenues"
FRAME = SiteFrame(48.7, 9.18)
AREA = shapely.box(-60, -60, 60, 60)
SENSORS = SHARED_DATA / "sensors"
RING = [[9.179, 48.6995], [9.181, 48.6995], [9.181, 48.7005], [9.179, 48.7005], [9.179, 48.6995]]


def files(*paths: Path) -> Callable[[], list[bytes]]:
    """The contents of files, as seeds."""
    return lambda: [path.read_bytes() for path in paths]


def made(name: str, write: Callable[[Path], object]) -> bytes:
    """The content of a file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


def _osm() -> bytes:
    return (AVENUES / "two-avenues.osm").read_bytes()


def _pbf(name: str) -> bytes:
    def write(path: Path) -> None:
        with osmium.SimpleWriter(str(path)) as writer:
            for item in osmium.FileProcessor(str(AVENUES / "two-avenues.osm")):
                writer.add(item)

    return made(name, write)


def inspected(path: Path) -> None:
    """What `inspect --json` does."""
    json.dumps(summary(path), allow_nan=False)


def read_map(path: Path) -> None:
    """What `inspect` and the scene do with an extract."""
    inspected(path)
    extract = read_extract(path)
    extract.features(FRAME, AREA)
    extract.clipped(FRAME, AREA, extract.highways())


def init_from_map(path: Path) -> None:
    summary(init_site(path.parent / "site", path))


def read_region(path: Path) -> None:
    polygon_in_site(polygon_from_geojson(read_geojson(path), file=path), FRAME, file=path)


def _regions() -> list[bytes]:
    polygon = {"type": "Polygon", "coordinates": [RING]}
    feature = {"type": "Feature", "properties": {"name": "a"}, "geometry": polygon}
    many = {"type": "FeatureCollection", "features": [feature]}
    multi = {"type": "MultiPolygon", "coordinates": [[RING]]}
    return [json.dumps(value).encode() for value in (polygon, many, multi)]


def _corrections() -> list[bytes]:
    """One of every kind that is read differently."""
    line = {"type": "LineString", "coordinates": RING[:3]}
    area = {"type": "Polygon", "coordinates": [RING]}
    point = {"type": "Point", "coordinates": RING[0]}
    lane = {"what": "lane", "side": "right", "kind": "bicycle", "width_m": 1.8}
    drawn = (
        ({"action": "tag", "element": "way/1", "tags": {"lanes": "3", "maxspeed": None}}, None),
        ({"action": "add", "what": "pole", "height_m": 8, "kind": "lamp"}, point),
        ({"action": "add", "what": "wall", "height_m": "2", "material": "stone"}, line),
        ({"action": "add", **lane, "element": "way/1"}, line),
        ({"action": "remove", "what": "tree"}, area),
        ({"action": "remove", "element": "node/3"}, None),
        ({"action": "move", "what": "curb"}, line),
    )
    features = [{"type": "Feature", "properties": one, "geometry": shape} for one, shape in drawn]
    return [json.dumps({"type": "FeatureCollection", "features": features}).encode()]


def read_site(path: Path) -> None:
    site = load_site(path)
    site.resolved()
    site.inputs()
    check_models(site.rig, file=path)


def _sites() -> list[bytes]:
    plain = yaml.safe_load((AVENUES / "site.yaml").read_text())
    del plain["dem"]  # which takes its time, and has a reader of its own
    full = {
        **plain,
        "region": {"polygon": "area.geojson"},
        "geometry": [
            {"file": "scan.obj", "crs": "EPSG:25832", "geometric_error_m": 0.5},
            {"file": "scan.obj", "origin": {"latitude": 48.7, "longitude": 9.18, "height_m": 1.0}},
            {"file": "scan.obj", "control_points": "points.csv", "up": "z", "unit": "m"},
        ],
        "imagery": ["picture.tif", {"xyz": "tiles/{z}/{x}/{y}.png", "zoom": 18}],
    }
    return [yaml.safe_dump(value, sort_keys=False).encode() for value in (plain, full)]


def _beside_site() -> dict[str, bytes]:
    return {
        "two-avenues.osm": _osm(),
        "two-avenues-dem.tif": (AVENUES / "two-avenues-dem.tif").read_bytes(),
        "area.geojson": _regions()[0],
        "scan.obj": b"v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n",
        "points.csv": b"model_x,model_y,model_z,x,y,z\n0,0,0,1,1,0\n",
        "picture.tif": _picture(3),
    }


def read_rig(path: Path) -> None:
    inspected(path)
    check_models(load_rig_spec(path), file=path)


def _rigs() -> list[bytes]:
    pole = {"name": "a", "model": "OS1-64", "east_m": 3.5, "north_m": -2, "height_m": 5.0}
    more = {
        "yaw_deg": 30.0,
        "pitch_deg": 4,
        "calibration": {"range_noise": 1.1, "light": 0.9},
        "outages": [{"channels": [1, 2]}],
        "effects": {"noise": True},
    }
    rigs = [{"rate_hz": 10, "sensors": [pole]}, {"frame": "site", "sensors": [pole | more, pole]}]
    rigs[1]["sensors"][1] = {**pole, "name": "b", "columns": 1024}
    return [yaml.safe_dump(rig, sort_keys=False).encode() for rig in rigs]


def _nodes() -> list[bytes]:
    rig = yaml.safe_load(_rigs()[0])
    error = {"bias": {"forward_m": 0.3, "yaw_deg": 1}, "walk": {"left_m": 0.1}}
    radio = {"latency_s": 0.1, "loss": 0.2, "outages": [{"start_s": 1.0, "stop_s": 2}]}
    first = {"name": "a", "rig": rig, "clock": {"offset_s": 0.1, "drift_ppm": 20}, "seed": 3}
    second = {"name": "b", "rig": {"ride": {"class": "bus"}, **rig}, "ride": 12,
              "pose_error": error, "radio": radio}  # fmt: skip
    second["rig"]["sensors"] = [{"name": "r", "model": "VLP-16", "forward_m": 0.5, "left_m": 0.0,
                                 "above_roof_m": 0.4}]  # fmt: skip
    value = {"rate_hz": 5.0, "nodes": [first, second]}
    return [yaml.safe_dump(value, sort_keys=False).encode()]


def read_nodes(path: Path) -> None:
    nodes = load_nodes(path)
    for number in range(len(nodes.nodes)):
        nodes.rig_of(number, FRAME, path.with_name("rig.yaml"))
    yaml.safe_dump(nodes.written())


def read_placement(path: Path) -> None:
    load_place_spec(path).sensors_of_models(path)


def _placements() -> list[bytes]:
    place = {"name": "corner", "east_m": 14.0, "north_m": -3, "heights_m": [4.0]}
    full = {
        "middle_m": [0, 1.5],
        "candidates": {
            "kinds": ["pole", "new-pole"],
            "area": [[0, 0], [9, 0], [0, 9]],
            "places": [place],
        },
        "models": [{"model": "VLP-16", "price": 4000.0, "columns": 900}],
        "costs": {"new_pole": 5000},
        "sensors": {"least": 1, "most": 2},
        "budget": 20000,
        "objectives": ["cost", "seen_20"],
        "conditions": {"weather": "rain", "visibility_m": 900.0},
    }
    return [yaml.safe_dump(full, sort_keys=False).encode()]


def _traffic() -> list[bytes]:
    value = {"per_hour": {"car": 600.0, "pedestrian": 100}, "duration_s": 5, "seed": 3}
    return [yaml.safe_dump(value).encode()]


def _raster(path: Path, bands: np.ndarray, **more: object) -> None:
    rows, columns = bands.shape[1:]
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=len(bands), dtype=bands.dtype,
        crs="EPSG:32632", transform=Affine(8.0, 0, 513044.0, 0, -8.0, 5394244.0), **more,
    ) as raster:  # fmt: skip
        raster.write(bands)


def _picture(bands: int, **more: object) -> bytes:
    pixels = np.random.default_rng(1).integers(0, 255, (bands, 60, 60)).astype(np.uint8)
    return made("a.tif", lambda path: _raster(path, pixels, **more))


def _pictures() -> list[bytes]:
    tiled = {"tiled": True, "blockxsize": 16, "blockysize": 16}
    packed = {"photometric": "YCBCR", "compress": "jpeg", "interleave": "pixel"}
    return [_picture(3), _picture(4, compress="deflate", **tiled), _picture(3, **packed)]


def _dems() -> list[bytes]:
    heights = np.random.default_rng(2).normal(300, 5, (1, 60, 60)).astype(np.float32)
    return [
        (AVENUES / "two-avenues-dem.tif").read_bytes(),
        made("a.tif", lambda path: _raster(path, heights, compress="lzw")),
        made("a.tif", lambda path: _raster(path, heights.astype(np.int16), nodata=-9999)),
    ]


def read_dem(path: Path) -> None:
    inspected(path)
    check_dem(path, FRAME, AREA)


def read_picture(path: Path) -> None:
    spec = ImagerySpec(file=path.name)
    source = ImagerySource(spec, Document(path.parent / "site.yaml", {"imagery": [{}]}), 0)
    read_orthophoto([source], FRAME, AREA)


def look_at(path: Path) -> None:
    """What `check` reads of a picture."""
    spec = ImagerySpec(file=path.name)
    source = ImagerySource(spec, Document(path.parent / "site.yaml", {"imagery": [{}]}), 0)
    look_at_picture(source, FRAME)


def check_map(path: Path) -> None:
    """What `check` does with an extract."""
    found = check_inputs(load_site(path.with_name("site.yaml")))
    json.dumps(found.as_json(), allow_nan=False)


def _site_of_map() -> dict[str, bytes]:
    site = yaml.safe_load((AVENUES / "site.yaml").read_text())
    del site["dem"]
    return {"site.yaml": yaml.safe_dump({**site, "osm": "map.osm"}).encode()}


def read_picture_tiles(path: Path) -> None:
    spec = ImagerySpec(xyz=f"{path.parent}/{{z}}_{{x}}_{{y}}.png", zoom=10)
    source = ImagerySource(spec, Document(path.parent / "site.yaml", {"imagery": [{}]}), 0)
    read_orthophoto([source], FRAME, AREA)


def _png_tile() -> list[bytes]:
    from PIL import Image

    pixels = np.random.default_rng(1).integers(0, 255, (256, 256, 3)).astype(np.uint8)
    small = Image.fromarray(pixels // 64 * 64)
    return [
        made("a.png", lambda path: small.quantize(8).convert("RGB").save(path)),
        made("a.jpg", lambda path: small.save(path, quality=20)),
        made("a.webp", lambda path: small.save(path, quality=20)),
    ]


HOUSES = [shapely.box(0, 0, 10, 8), shapely.box(30, 5, 42, 20), shapely.box(-30, -40, -20, -30)]


def _write_footprints(path: Path) -> None:
    raw = [shapely.to_wkb(shapely.transform(h, FRAME.lonlat_from_site)) for h in HOUSES]
    pyogrio.raw.write(
        path, np.array(raw, object), field_data=[], fields=[], crs="EPSG:4326",
        geometry_type="Polygon",
    )  # fmt: skip


def _footprints(name: str) -> Callable[[], Sequence[bytes]]:
    return lambda: [made(name, _write_footprints)]


def _shapefile() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        _write_footprints(Path(folder) / "houses.shp")
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def outlines(path: Path) -> None:
    read_footprints(path, FRAME, AREA, crs="EPSG:4326")


def _pattern(ending: str) -> list[bytes]:
    time_s = np.arange(400) / 100
    table = {
        "time_s": time_s,
        "azimuth_deg": 19 * np.cos(41 * time_s),
        "elevation_deg": 19 * np.sin(24 * time_s),
        "line": np.repeat([0, 1], 200),
    }
    table["time_s"] = np.tile(time_s[:200], 2)
    if ending == "npz":
        return [made("a.npz", lambda path: np.savez(path, **table))]
    rows = np.column_stack(list(table.values()))

    def write(path: Path) -> None:
        np.savetxt(
            path, rows, "%.6f", ",", header="# period_s: 2.0\n" + ",".join(table), comments=""
        )

    return [made("a.csv", write)]


def _pattern_sensor() -> list[bytes]:
    value = {"name": "Rose", "maker": "me", "pattern": "rosette.npz", "range_min_m": 0.1}
    value |= {"points_per_second": 60_000, "range_max_m": 90}
    names = (
        "reference_reflectivity reference_range_m range_sigma_m range_resolution_m wavelength_nm"
    )
    value |= dict.fromkeys(names.split())
    return [yaml.safe_dump(value).encode()]


def _own_sensors() -> list[bytes]:
    folder = Path(__file__).parents[2] / "src" / "urbantwin" / "lidar" / "sensors"
    return [(folder / name).read_bytes() for name in ("vlp-16.yaml", "os1-32.yaml")]


CAMPAIGN = b"""sites: {a: twin}
seeds: {first: 1, count: 3}
rigs: [own, m]
weather:
  dry: {}
  fog: {weather: fog, visibility_m: 90, effects: "no-sun", missing: 0.1}
scenarios: {none: none, s: m}
exclude: [{seed: [1, 2], weather: fog}, {rig: m, scenario: s}]
duration_s: 12
start_s: 1
every: 2
storage: zstd
split: {by: scenario, shares: [70, 30], seed: 4}
shards: {format: parquet, megabytes: 20, seed: 2}
"""

STUDY = b"""twin: twin
seeds: [1, 2]
seconds: 12
train: {steps: 20, seeds: [7, 8]}
classes: [car]
design: factorial
factors:
  sway_m: [0, 0.01]
  outage_unit: [none, a]
  pose_error_m: {levels: [0, 0.5], sensors: [a, b], memory_s: 5}
  fog_visibility_m: [none, 200]
"""

CURRICULA = [
    b"twin: twin\nladder: range\nseconds: 20\nstart: 5\nstop: 15\nseed: 7\n",
    b"twin: twin\ngrades:\n  - {name: easy, density: 0.3, raised_m: 2, range_m: 20}\n",
]
RUN = b"""twin: twin
traffic: {seconds: 60, seed: 7, demand: m, scenario: m}
record: {rig: m, start: 5, stop: 15, weather: rain, visibility: 800, effects: none, seed: 3}
"""

OBJECTS = b"""
lantern:
  tags: {highway: street_lamp, lamp_model: [lantern, "old*"], bench: null}
  counted: lanterns
  placed: lamp
  sizes:
    height: {tag: [height, est_height], usual: min(usual_height, 6) ** 1, least: 3, most: 12}
    seats: {tag: seats, count: true, usual: 2}
    body: {tag: material, usual: wood, choices: {steel: metal-bare}}
  parts:
    - {drum: height - 0.4, at: [0, 0, 0], radius: 0.11, top: 0.07, material: body, class: pole}
    - {box: [0.4, 0.5 * seats, 0.1], at: [1, 0, 0.4], material: wood, mirror: y, when: {seats: no}}
  arms: [{bar: [[0, 0, height], [reach, 0, height]], radius: 0.03, material: glass, sides: 6}]
"""


def read_street_objects(path: Path) -> None:
    for one in street_objects(path):
        one.pieces({"height": "9", "seats": "3", "material": "steel"}, (0.0, 3.1))


READERS = [
    Reader("osm", read_map, "map.osm", lambda: [_osm()]),
    Reader("osm of a city", read_map, "map.osm",
           files(SHARED_DATA / "osm/perth_stretched_lights.osm"), real=True),
    Reader("init", init_from_map, "map.osm", lambda: [_osm()]),
    Reader("osm.gz", read_map, "map.osm.gz", lambda: [gzip.compress(_osm(), mtime=0)]),
    Reader("osm.bz2", read_map, "map.osm.bz2", lambda: [bz2.compress(_osm())]),
    Reader("osm.pbf", read_map, "map.osm.pbf", lambda: [_pbf("map.osm.pbf")]),
    Reader("region", read_region, "area.geojson", _regions),
    Reader("site", read_site, "site.yaml", _sites, _beside_site),
    Reader("corrections", lambda path: read_corrections(path, FRAME, AREA), "corrections.geojson",
           _corrections),
    Reader("street objects", read_street_objects, "street_objects.yaml", lambda: [OBJECTS]),
    Reader("rig", read_rig, "rig.yaml", _rigs),
    Reader("nodes", read_nodes, "nodes.yaml", _nodes),
    Reader("study", StudyFile.read, "grid.yaml", lambda: [STUDY], lambda: {"twin": b"", "m": b""}),
    Reader("campaign", CampaignFile.read, "grid.yaml", lambda: [CAMPAIGN], {"twin": b"", "m": b""}),
    Reader("curriculum", CurriculumFile.read, "grid.yaml", lambda: CURRICULA, {"twin": b""}),
    Reader("run", RunFile.read, "run.yaml", lambda: [RUN], {"twin": b"", "m": b""}),
    Reader("placement", read_placement, "place.yaml", _placements),
    Reader("traffic changes", load_traffic_changes, "traffic.yaml", _traffic),
    Reader("dem", read_dem, "dem.tif", _dems),
    Reader("imagery", read_picture, "picture.tif", _pictures),
    Reader("imagery looked at", look_at, "picture.tif", _pictures),
    Reader("check", check_map, "map.osm", lambda: [_osm()], _site_of_map),
    Reader("imagery tiles", read_picture_tiles, "10_538_352.png", _png_tile),
    Reader("footprints gpkg", outlines, "houses.gpkg", _footprints("a.gpkg")),
    Reader("footprints geojson", outlines, "houses.geojson", _footprints("a.geojson")),
    Reader("footprints shp", outlines, "houses.shp", lambda: [_shapefile()["houses.shp"]],
           _shapefile),
    Reader("sensor", load_sensor, "own.yaml", _own_sensors),
    Reader("pattern sensor", load_sensor, "own.yaml", _pattern_sensor,
           lambda: {"rosette.npz": _pattern("npz")[0]}),
    Reader("ouster", load_sensor, "unit.json",
           files(SENSORS / "ouster/1_14_beta_os1-991937000062-64_legacy.json",
                 SENSORS / "ouster/OS-1-32-G_v2.1.1_1024x10.json",
                 SENSORS / "ouster/3_0_1_os-122246000293-128.json"), real=True),
    Reader("hesai", lambda path: load_sensor(path, model="PandarXT-32"), "unit.csv",
           files(SENSORS / "hesai_general_ros/PandarXT-32.csv"), real=True),
    Reader("scan pattern csv", load_scan_pattern, "pattern.csv", lambda: _pattern("csv")),
    Reader("scan pattern npz", load_scan_pattern, "pattern.npz", lambda: _pattern("npz")),
]  # fmt: skip


@pytest.mark.parametrize("mutations", NUMBERS)
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_bad_files(reader: Reader, mutations: int, fuzz: Callable[[Reader, int], None]) -> None:
    fuzz(reader, mutations)
