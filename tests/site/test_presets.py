"""Presets: published poses against geodesy, a site that builds, and what is said to be unknown."""

import json
import re
from pathlib import Path

import numpy as np
import osmium
import osmium.osm
import pytest
import yaml
from pyproj import Geod, Transformer

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.errors import InputError
from urbantwin.geometry import Pose, SiteFrame
from urbantwin.lidar import sensor
from urbantwin.site import load_site, read_extract
from urbantwin.site.presets import preset, preset_names
from urbantwin.site.presets.preset_site import per_hour_of_presence, street_corner

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues" / "two-avenues.osm"
GEOD = Geod(ellps="WGS84")
#: The zone that TUMTraf's map lies in, and the origin of s110_base in it.
UTM = Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
EAST, NORTH = 695942.4856864865 - 631.98486299, 5346521.128436302 + 854.96568588


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_names_sensors_that_exist_and_what_nobody_published(name: str) -> None:
    one = preset(name)
    assert one.name == name
    for unit in one.rig.sensors:
        model = sensor(unit.model)
        assert unit.columns in (None, *model.columns_options)
        assert any(text.startswith(f"{unit.name}: ") for text in one.unknown)
    assert one.homepage.startswith("http")
    assert len({unit.name for unit in one.rig.sensors}) == len(one.rig.sensors)


def lonlat_of_s110(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Longitude and latitude of points of s110_base, whose x is the grid's north, y its west."""
    return UTM.transform(EAST - points[:, 1], NORTH + points[:, 0])


@pytest.mark.parametrize("number", [0, 1])
def test_a_published_pose_stands_where_geodesy_has_it(number: int, shared_data: Path) -> None:
    """The sensor, and what it sees 30 m ahead, to its left and above, by distance and azimuth."""
    one = preset("tumtraf-s110")
    unit, place = one.rig.sensors[number], one.place
    assert place is not None
    fields = unit.model_dump()
    site = SiteFrame(place.latitude, place.longitude)
    xy = site.site_from_lonlat([[fields["longitude"], fields["latitude"]]])[0]
    ours = Pose.from_ypr(
        [*xy, fields["up_m"]],
        *np.radians([fields["yaw_deg"], fields["pitch_deg"], fields["roll_deg"]]),
    )
    seen = np.vstack([np.zeros(3), 30.0 * np.eye(3), -30.0 * np.eye(3)])
    published = json.loads((shared_data / "sites" / "tumtraf-s110.json").read_text())["sensors"]
    matrix = np.array(published[f"ouster_{unit.name}"]["base_SE3_sensor"])[:3]
    base = seen @ matrix[:, :3].T + matrix[:, 3]
    found = ours.apply(seen)
    lon, lat = lonlat_of_s110(base)
    here = np.full(len(lon), place.longitude), np.full(len(lon), place.latitude)
    azimuth, _, metres = GEOD.inv(*here, lon, lat)
    east, north = metres * np.sin(np.radians(azimuth)), metres * np.cos(np.radians(azimuth))
    # The anchor is the frame's origin to seven digits (1 cm); a grid is 7 cm in 1 km too long.
    np.testing.assert_allclose(found, np.column_stack([east, north, base[:, 2]]), atol=0.015)


@pytest.fixture(scope="module")
def at_s110(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example's map, moved to Garching, and the preset's site."""
    folder = tmp_path_factory.mktemp("s110")
    place = preset("tumtraf-s110").place
    assert place is not None

    def moved(key: str, by: float) -> None:
        nonlocal text
        text = re.sub(
            rf'{key}="([\d.]+)"', lambda found: f'{key}="{float(found[1]) + by:.7f}"', text
        )

    text = EXAMPLE.read_text()
    moved("lat", place.latitude - 48.7)
    moved("lon", place.longitude - 9.18)
    (folder / "map.osm").write_text(text)
    arguments = ["--osm", str(folder / "map.osm"), "--preset", "TUMTraf_s110", "--radius", "40"]
    assert main(["init", str(folder / "site"), *arguments, "--quiet"]) == 0
    return folder / "site" / "site.yaml"


def test_the_site_says_where_its_values_are_from(at_s110: Path) -> None:
    text = at_s110.read_text(encoding="utf-8")
    for said in ("# Unknown:", "calib/s110_lidar_ouster_south.json", "hd_map.py", "CC BY-NC-ND"):
        assert said in text
    site = load_site(at_s110)
    assert site.name == preset("tumtraf-s110").title
    assert (site.latitude, site.longitude) == (48.2494789, 11.6310746)
    per_hour = site.traffic.per_hour
    assert per_hour["car"] / per_hour["van"] == pytest.approx(7.702 / 1.409, rel=0.02)
    assert per_hour["truck"] > per_hour["bus"] > 0
    south, north = site.rig.sensors
    assert (south.name, south.up_m, north.up_m) == ("south", 7.4808, 7.0)
    assert not south.proposed


def test_the_twin_has_the_rig_at_its_published_poses(at_s110: Path, tmp_path: Path) -> None:
    fields = yaml.safe_load(at_s110.read_text(encoding="utf-8")) | {"closed_loop": False}
    site = at_s110.with_name("open.yaml")
    site.write_text(yaml.safe_dump(fields))
    twin = ut.build(site, tmp_path / "twin", pictures=False, progress=False)
    rig = yaml.safe_load((twin.folder / "rig.yaml").read_text())
    site = SiteFrame(48.2494789, 11.6310746)
    for unit, built in zip(preset("tumtraf-s110").rig.sensors, rig["sensors"], strict=True):
        fields = unit.model_dump()
        xy = site.site_from_lonlat([[fields["longitude"], fields["latitude"]]])[0]
        assert (built["east_m"], built["north_m"]) == pytest.approx(tuple(xy), abs=1e-3)
        for field in ("up_m", "yaw_deg", "pitch_deg", "roll_deg"):
            assert built[field] == pytest.approx(fields[field], abs=1e-4)
        assert (built["model"], built["columns"]) == ("OS1-64-BH", 2048)


@pytest.mark.parametrize(
    ("name", "extract", "streets"),
    [
        ("munich", "munich.osm", [["Lerchenauer Str"], ["moosacher"]]),
        ("taipei", "taipei.osm", [["中山北路二段"], ["南京東路"]]),
        ("london", "london-borough.osm", [["Silvester Street"], ["GREAT DOVER"]]),
    ],
)
def test_streets_meet_where_they_share_nodes(
    shared_data: Path, name: str, extract: str, streets: list[list[str]]
) -> None:
    path = shared_data / "osm" / extract
    named: list[set[int]] = [set(), set()]
    places = {}
    for item in osmium.FileProcessor(str(path)):
        if isinstance(item, osmium.osm.Node):
            places[item.id] = (item.location.lat, item.location.lon)
        elif isinstance(item, osmium.osm.Way) and "highway" in item.tags:
            for number, starts in enumerate(streets):
                if item.tags.get("name", "").lower().startswith(starts[0].lower()):
                    named[number] |= {node.ref for node in item.nodes}
    shared = np.array([places[node] for node in sorted(named[0] & named[1])])
    middle = np.median(shared, axis=0)  # they meet again farther away
    rough = SiteFrame(float(middle[0]) + 0.0012, float(middle[1]) - 0.0012)
    found = street_corner(read_extract(path), rough, streets, 400.0)
    assert found is not None
    assert GEOD.inv(middle[1], middle[0], found[1], found[0])[2] < 15.0
    assert street_corner(read_extract(path), rough, streets, 60.0) is None
    assert street_corner(read_extract(path), rough, [*streets, ["Nowhere"]], 400.0) is None


def test_classes_are_shared_out_as_they_were_seen() -> None:
    guess = {"car": 800, "truck": 100, "bus": 100, "tram": 6, "pedestrian": 300}
    found = per_hour_of_presence({"car": 6.0, "van": 2.0, "truck": 2.0, "pedestrian": 1.0}, guess)
    # A thousand motor vehicles; a walker is there 6 / 1.3 times as long as one of them.
    assert found == {"car": 600, "truck": 200, "tram": 6, "pedestrian": 22, "van": 200}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"preset": "tumtraf"}, "tumtraf-s110"),
        ({"preset": "lumpi", "offline": True}, "openstreetmap.org/export#map=17/52.3778"),
        ({"preset": "lumpi", "lat": 52.37, "lon": 9.72}, "openstreetmap.org/export"),
        ({"preset": "dair-v2x"}, "--osm"),
        ({"preset": "dair-v2x", "osm": EXAMPLE}, "--lat and --lon"),
        ({"preset": "tumtraf-s110", "osm": EXAMPLE, "at_junction": True}, "--at-junction"),
        ({"preset": "tumtraf-s110", "osm": EXAMPLE, "lat": 48.7, "lon": 9.18}, "188 km"),
        ({"preset": "tumtraf-s110", "roads": "a.xodr", "osm": EXAMPLE}, "map of the roads"),
    ],
)
def test_a_preset_that_does_not_fit_is_one_line(
    tmp_path: Path, arguments: dict[str, object], told: str
) -> None:
    if "offline" in arguments:
        arguments = {**arguments, "cache": tmp_path / "empty"}
    with pytest.raises(InputError, match=re.escape(told)) as caught:
        ut.init(tmp_path / "new", progress=False, **arguments)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "new").exists()


@pytest.mark.thorough
def test_sensors_of_unknown_place_stand_at_their_corners(tmp_path: Path) -> None:
    """At any junction that a person takes for the place of a preset without one."""
    site = ut.init(
        tmp_path / "new", osm=EXAMPLE, preset="mixed-signals", at_junction=True, progress=False
    ).checked
    top, dome = site.rig.sensors
    assert top.height_m == 2.5
    between = np.array([dome.east_m, dome.north_m, dome.height_m]) - [
        top.east_m, top.north_m, top.height_m,
    ]  # fmt: skip
    np.testing.assert_allclose(between, [0.044, 0.014, -0.263], atol=1e-4)
    assert not top.proposed
