"""Materials of a whole twin: a bridge over a street, and a picture of the lawns around them."""

import json
import shutil

import numpy as np
import pytest
import rasterio
import shapely
import yaml
from matplotlib.image import imread
from pyproj import Transformer
from rasterio.transform import Affine

from urbantwin.drawing import ground_materials
from urbantwin.drawing.ground_materials import ground_picture, materials_from_above
from urbantwin.geometry import SurfaceMaterials
from urbantwin.lidar import Scanner, place_rig
from urbantwin.roads.marking import painted
from urbantwin.site import load_site
from urbantwin.taxonomy import material_id, materials
from urbantwin.twin import build_twin, load_twin

LATITUDE, LONGITUDE = 48.7, 9.18
PAINT = material_id("road-paint")
RIG = {
    "rig": {
        "sensors": [
            {"name": "a", "model": "OS1-128", "east_m": 9.0, "north_m": 25.0, "height_m": 5.0}
        ]
    }
}


def lawn_picture(path, half=260.0, pixel_m=0.5):
    """A lawn, greyer along both streets, in the zone's UTM."""
    zone = f"EPSG:{32600 + int((LONGITUDE + 180) // 6) + 1}"
    middle = Transformer.from_crs("EPSG:4326", zone, always_xy=True).transform(LONGITUDE, LATITUDE)
    count = int(2 * half / pixel_m)
    at = (np.arange(count) + 0.5) * pixel_m - half
    x, y = np.meshgrid(at, -at)
    grey = (np.abs(x) < 9) | (np.abs(y) < 9)
    rgb = np.where(grey[..., None], [105, 104, 103], [70, 95, 50]).astype(np.uint8)
    rgb = np.clip(rgb + np.random.default_rng(0).normal(0, 4, rgb.shape), 0, 255).astype(np.uint8)
    transform = Affine(pixel_m, 0, middle[0] - half, 0, -pixel_m, middle[1] + half)
    with rasterio.open(
        path, "w", driver="GTiff", width=count, height=count, count=3, dtype="uint8",
        crs=zone, transform=transform,
    ) as out:  # fmt: skip
        out.write(np.moveaxis(rgb, 2, 0))


def write_map(path):
    """Two streets that cross, one of them on a bridge, and bare soil around them."""
    north, east = 1 / 111_194.9, 1 / (111_194.9 * np.cos(np.radians(LATITUDE)))
    nodes = [(-200, 0), (-40, 0), (40, 0), (200, 0), (0, -150), (0, 150)]
    nodes += [(-250, -250), (250, -250), (250, 250), (-250, 250)]
    over = {"highway": "primary", "lanes": "2"}
    ways = [
        ([1, 2], over),
        ([2, 3], {**over, "bridge": "yes", "layer": "1"}),
        ([3, 4], over),
        ([5, 6], {"highway": "residential", "lanes": "2"}),
        ([7, 8, 9, 10, 7], {"landuse": "construction"}),
    ]
    lines = [
        f'<node id="{k}" version="1" lat="{LATITUDE + y * north}" lon="{LONGITUDE + x * east}"/>'
        for k, (x, y) in enumerate(nodes, start=1)
    ]
    for k, (refs, tags) in enumerate(ways, start=1):
        inner = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        inner += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        lines.append(f'<way id="{k}" version="1">{inner}</way>')
    path.write_text(f'<osm version="0.6">{"".join(lines)}</osm>')


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    folder = tmp_path_factory.mktemp("materials")
    write_map(folder / "map.osm")
    lawn_picture(folder / "lawn.tif")
    site = {
        "anchor": {"latitude": LATITUDE, "longitude": LONGITUDE},
        "region": {"radius_m": 120},
        "closed_loop": False,
        "osm": "map.osm",
        "imagery": [{"file": "lawn.tif", "attribution": "Survey of Lawns"}],
        **RIG,
    }
    (folder / "site.yaml").write_text(yaml.safe_dump(site))
    return build_twin(load_site(folder / "site.yaml"), folder / "twin")


def test_paint_of_the_bridge_lies_on_the_bridge(twin):
    surface = twin.surface_materials
    levels = {layer.level for layer in surface.layers if layer.material == PAINT}
    assert levels == {0, 1}
    marks = painted(twin.roads, twin.lane_model)
    middle = marks.quads[marks.level == 1].mean(axis=1)
    middle = middle[np.abs(middle[:, 0]) < 30]
    street = np.abs(middle[:, 0]) < 8  # the street's own marks may be below
    deck = twin.ground_mesh.vertices[:, 2].max()
    assert deck > 4.0
    up, down = (np.column_stack([middle, np.full(len(middle), z)]) for z in (deck, 0.0))
    assert (surface.at(up)[~street] == PAINT).mean() > 0.9
    assert not (surface.at(down)[~street] == PAINT).any()


def test_the_picture_turns_soil_into_lawn_and_leaves_roads(twin):
    surface = twin.surface_materials
    rng = np.random.default_rng(1)
    xy = rng.uniform(-80, 80, (4000, 2))
    lawn = (np.abs(xy) > 14).all(axis=1)
    assert (surface.at(xy[lawn]) == material_id("grass")).mean() > 0.95
    road = (np.abs(xy[:, 0]) < 2) & (np.abs(xy[:, 1]) > 20)
    assert not (surface.at(xy[road]) == material_id("grass")).any()
    notes = twin.manifest["notes"]["materials"]
    assert "too coarse" in notes["paint"]
    assert notes["imagery"][0]["covers"] > 0.9
    (entry,) = [one for one in twin.manifest["inputs"] if one["kind"] == "imagery"]
    assert (entry["name"], entry["attribution"]) == ("lawn.tif", "Survey of Lawns")


def test_beams_see_paint_and_lawn_at_the_same_places_as_before(twin):
    rig = place_rig(twin.rig_spec(), twin.mesh, file="rig.yaml")
    frames = [
        Scanner(twin.mesh, rig, seed=1, surface=surface).scan(0, [])
        for surface in (None, twin.surface_materials)
    ]
    plain, painted_frame = (
        {key: n for n, key in enumerate(zip(f.ring.tolist(), f.column.tolist(), strict=True))}
        for f in frames
    )
    both = sorted(plain.keys() & painted_frame.keys())
    assert len(both) > 0.9 * len(plain)
    first, second = (
        frame.points[[index[key] for key in both]]
        for frame, index in zip(frames, (plain, painted_frame), strict=True)
    )
    site = rig.dataset_SE3_site.inverse().apply(first[:, :3].astype(np.float64))
    surface = twin.surface_materials.at(np.column_stack([site[:, :2], site[:, 2]]))
    ratio = np.maximum(second[:, 3], 1 / 255) / np.maximum(first[:, 3], 1 / 255)
    bright = first[:, 3] > 0.06  # intensities come in steps of 1/255
    white = (first[:, 3] > 0.02) & (surface == PAINT)
    assert white.sum() > 30
    # Oren and Nayar 1994, eq. 30, with light and view along one line; beads add the same at every
    # angle of the ground's slant.
    sensor = rig.sensors[0].site_SE3_sensor.translation
    down = np.abs((site - sensor)[white, 2]) / np.linalg.norm((site - sensor)[white], axis=1)
    paint, asphalt = (
        one.reflectivity_at(865) * (a * down + b * (1 - down**2)) + one.retro
        for one in (materials()["road-paint"], materials()["asphalt"])
        for v in [np.radians(one.roughness_deg) ** 2]
        for a, b in [(1 - 0.5 * v / (v + 0.33), 0.45 * v / (v + 0.09))]
    )
    assert np.median(ratio[white]) == pytest.approx(np.median(paint / asphalt), rel=0.15)
    lawn = bright & (surface == material_id("grass"))
    grass, soil = materials()["grass"], materials()["soil"]
    expected = grass.reflectivity_at(865) / soil.reflectivity_at(865)
    assert np.median(ratio[lawn]) == pytest.approx(expected, rel=0.1)
    same = surface == 0
    assert (np.abs(ratio[same & bright] - 1) < 0.35).mean() > 0.95


def test_a_picture_shows_what_the_ground_is_made_of(twin, tmp_path, monkeypatch):
    """Green where the lawn is, grey along the streets; and the legend's names are legible."""
    monkeypatch.setattr(ground_materials, "_PIXELS", 350)
    path = ground_picture(
        twin.mesh, twin.surface_materials, shapely.box(-60, -60, 60, 60), tmp_path / "ground.png"
    )
    picture = imread(path)[..., :3]
    found = materials_from_above(twin.mesh, twin.surface_materials, -60.0, -60.0, 1.0, (120, 120))
    assert (found[75:115, 75:115] == material_id("grass")).mean() > 0.9
    assert (found[20:40, 59:61] == material_id("asphalt")).mean() > 0.8
    green = picture[..., 1] - (picture[..., 0] + picture[..., 2]) / 2
    rows, columns = np.nonzero(green > 0.1)
    assert len(rows) > 0.3 * picture[..., 0].size * 0.7
    assert np.ptp(columns) > 0.9 * 0.96 * picture.shape[1]


def test_an_older_twin_without_them_still_opens(twin, tmp_path):
    old = tmp_path / "old"
    shutil.copytree(twin.folder, old)
    (old / "surface_material.npz").unlink()
    manifest = json.loads((old / "twin.json").read_text())
    del manifest["files"]["surface_material.npz"]
    (old / "twin.json").write_text(json.dumps(manifest))
    assert load_twin(old).surface_materials.layers == SurfaceMaterials().layers
