"""``site.yaml``: what a good one gives, and the line that each bad one gets."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import yaml
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.site import check_extract, load_site, read_extract
from urbantwin.taxonomy import ACTOR_CLASSES

from .conftest import LATITUDE, LONGITUDE, OSM, SENSOR, site_fields

Write = Callable[[object], Path]


def spoilt(*path: str | int, **changes: Any) -> dict[str, Any]:
    """Return good fields with the mapping at ``path`` changed; ``None`` removes a field."""
    fields = site_fields()
    part: Any = fields
    for step in path:
        part = part[step]
    for name, value in changes.items():
        if value is None:
            del part[name]
        else:
            part[name] = value
    return fields


def error_of(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_site(path)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_good_site(write_site: Write) -> None:
    site = load_site(write_site(site_fields()))
    assert (site.latitude, site.longitude) == (LATITUDE, LONGITUDE)
    assert site.region.contains(shapely.Point(0, 0))
    assert site.region.area == pytest.approx(np.pi * 100**2, rel=0.01)
    assert site.traffic.per_hour == dict.fromkeys(ACTOR_CLASSES, 0.0) | {
        "car": 600.0,
        "pedestrian": 100.0,
    }
    assert site.traffic.duration_s == 5.0
    assert site.osm.licence == "ODbL-1.0"
    assert site.rig.sensors[0].model == "OS1-128"
    check_extract(site, read_extract(site.osm.path))


def test_only_the_place_the_map_and_the_rig_must_be_said(write_site: Write) -> None:
    fields = {name: site_fields()[name] for name in ("anchor", "osm", "rig")}
    site = load_site(write_site(fields))
    assert site.dem is None
    assert all(count > 0 for count in site.traffic.per_hour.values())


def lanes_of_approach(shares: dict[str, float]) -> dict[str, Any]:
    return {"approach": 1, "lanes": [{"turn": 2, "shares": shares}]}


BAD: dict[str, tuple[dict[str, Any], list[str]]] = {
    "unknown field": (
        spoilt(regoin={"radius_m": 5}),
        ["regoin (line", "not a field", "expected 'region'"],
    ),
    "unknown nested field": (
        spoilt("traffic", duration=3),
        ["traffic.duration (line", "expected 'duration_s'"],
    ),
    "missing anchor": (spoilt(anchor=None), ["anchor: is missing", "latitude and longitude"]),
    "missing latitude": (spoilt("anchor", latitude=None), ["anchor.latitude", "is missing"]),
    "missing osm": (spoilt(osm=None), ["osm", "is missing", "OpenStreetMap"]),
    "missing rig": (spoilt(rig=None), ["rig", "is missing", "sensors"]),
    "latitude too large": (
        spoilt("anchor", latitude=91),
        ["anchor.latitude (line 3)", "91", "at most 90"],
    ),
    "longitude is text": (
        spoilt("anchor", longitude="east"),
        ["anchor.longitude", "'east'", "expected a number"],
    ),
    "latitude is true": (spoilt("anchor", latitude=True), ["anchor.latitude", "a number"]),
    "latitude is nan": (
        spoilt("anchor", latitude=float("nan")),
        ["anchor.latitude", "nan", "finite"],
    ),
    "radius zero": (spoilt("region", radius_m=0), ["region.radius_m", "is 0 m", "20 to 2000 m"]),
    "radius negative": (spoilt("region", radius_m=-5), ["region.radius_m", "is -5 m"]),
    "radius huge": (
        spoilt("region", radius_m=50_000),
        ["region.radius_m", "50000 m", "precision", "at most 2000 m"],
    ),
    "radius infinite": (spoilt("region", radius_m=float("inf")), ["region.radius_m", "inf"]),
    "radius and polygon": (
        spoilt("region", polygon={"type": "Polygon"}),
        ["region (line", "radius_m or polygon"],
    ),
    "unknown class": (
        spoilt("traffic", "per_hour", cars=3),
        ["traffic.per_hour.cars (line", "not a class of actors", "expected 'car'"],
    ),
    "odd class": (
        spoilt("traffic", "per_hour", zeppelin=3),
        ["traffic.per_hour.zeppelin", "one of car, truck, bus"],
    ),
    "negative count": (
        spoilt("traffic", "per_hour", car=-3),
        ["traffic.per_hour.car (line", "-3", "at least 0"],
    ),
    "count nan": (
        spoilt("traffic", "per_hour", car=float("nan")),
        ["traffic.per_hour.car", "nan", "finite"],
    ),
    "no duration": (spoilt("traffic", duration_s=0), ["traffic.duration_s", "more than 0"]),
    "shares of lanes": (
        spoilt("traffic", approaches=[lanes_of_approach({"1_0": 0.5, "1_1": 0.4})]),
        ["traffic.approaches[0].lanes[0].shares (line", "are 0.9 together", "expected 1"],
    ),
    "a negative share": (
        spoilt("traffic", approaches=[lanes_of_approach({"1_0": -0.5, "1_1": 1.5})]),
        ["traffic.approaches[0].lanes[0].shares.1_0 (line", "-0.5", "at least 0"],
    ),
    "setting out": (
        spoilt("traffic", counted_set_out="sometimes"),
        ["traffic.counted_set_out (line", "sometimes", "evenly", "at_random"],
    ),
    "negative seed": (spoilt("traffic", seed=-1), ["traffic.seed", "at least 0"]),
    "broken seed": (spoilt("traffic", seed=1.5), ["traffic.seed", "1.5", "a whole number"]),
    "traffic is a list": (spoilt(traffic=[1]), ["traffic", "a list", "a mapping"]),
    "osm not there": (spoilt(osm="nowhere.osm"), ["osm.file", "nowhere.osm", "not found"]),
    "osm is a folder": (spoilt(osm="."), ["osm.file", "is a folder"]),
    "osm has a null byte": (spoilt(osm="a\0b"), ["osm.file", "not found"]),
    "dem not there": (spoilt(dem="nowhere.tif"), ["dem.file", "nowhere.tif", "not found"]),
    "rig not there": (spoilt(rig="nowhere.yaml"), ["rig (line", "nowhere.yaml", "not found"]),
    "rig is a number": (spoilt(rig=3), ["rig", "neither", "sensors"]),
    "polygon not there": (
        spoilt(region={"polygon": "nowhere.geojson"}),
        ["region.polygon", "nowhere.geojson", "not found"],
    ),
    "driving side": (
        spoilt(roads={"driving_side": "middle"}),
        ["roads.driving_side", "'middle'", "'left' or 'right'"],
    ),
    "sensor under the ground": (
        spoilt("rig", "sensors", 0, height_m=-2.0),
        ["rig.sensors[0].height_m (line", "under the ground", "above the ground"],
    ),
    "no sensors": (spoilt("rig", sensors=[]), ["rig.sensors", "is empty", "at least one"]),
    "unknown sensor field": (
        spoilt("rig", "sensors", 0, hieght_m=2.0),
        ["rig.sensors[0].hieght_m (line", "expected 'height_m'"],
    ),
    "name not text": (spoilt(name=3), ["name (line 1)", "is 3", "expected text"]),
}


@pytest.mark.parametrize(("fields", "words"), BAD.values(), ids=BAD.keys())
def test_bad_value_is_named(write_site: Write, fields: dict[str, Any], words: list[str]) -> None:
    path = write_site(fields)
    text = error_of(path)
    assert text.startswith(f"{path}: ")
    for word in words:
        assert word in text


BAD_TEXT = {
    "empty": ("", "is empty"),
    "comment": ("# nothing\n", "is empty"),
    "a list": ("- a\n- b\n", "holds a list"),
    "a word": ("site", "holds a single value"),
    "broken": ("anchor: {latitude: 1\nname: x\n", "is not YAML"),
    "a key twice": ("name: a\nosm: b\nname: c\n", "line 3: 'name' is given twice"),
    "an object": ("name: !!python/object/apply:os.getcwd []\n", "is not YAML"),
    "a control character": ("name: \x01\n", "is not YAML"),
    "an impossible date": ("name: 2024-99-99\n", "is not YAML"),
    "nested too deep": ("[" * 500, "is nested too deep"),
    "a number as key": ("1: 2\n", "name is not text"),
    "an alias to nothing": ("name: *x\n", "is not YAML"),
}


@pytest.mark.parametrize(("text", "words"), BAD_TEXT.values(), ids=BAD_TEXT.keys())
def test_what_is_no_site_is_refused(write_site: Write, text: str, words: str) -> None:
    assert words in error_of(write_site(text))


def test_missing_file_folder_and_binary_file(tmp_path: Path) -> None:
    assert "nowhere.yaml: not found" in error_of(tmp_path / "nowhere.yaml")
    assert "is a folder" in error_of(tmp_path)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(bytes(range(256)) * 8)
    assert "is not text" in error_of(binary)


def test_exponents_are_numbers(write_site: Write) -> None:
    text = yaml.safe_dump(site_fields()).replace("radius_m: 100", "radius_m: 1e2")
    assert load_site(write_site(text)).radius_m == 100.0


def test_rig_in_a_file_of_its_own(write_site: Write, tmp_path: Path) -> None:
    rig = {"rate_hz": 20, "sensors": [SENSOR]}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    site = load_site(write_site(spoilt(rig="rig.yaml")))
    assert (site.rig.rate_hz, site.rig_file) == (20.0, tmp_path / "rig.yaml")
    rig["sensors"] = [SENSOR | {"pitch_deg": "down"}]
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    text = error_of(tmp_path / "site.yaml")
    assert text.startswith(f"{tmp_path / 'rig.yaml'}: sensors[0].pitch_deg (line")


def test_inputs_carry_hash_and_licence(write_site: Write, tmp_path: Path) -> None:
    site = load_site(write_site(site_fields()))
    (entry,) = site.inputs()
    # sha256sum's own answer for the bytes, through another door.
    import subprocess

    printed = subprocess.run(
        ["sha256sum", str(tmp_path / "map.osm")], capture_output=True, text=True, check=True
    ).stdout
    assert entry["sha256"] == printed.split()[0]
    assert entry["name"] == "map.osm"
    assert entry["licence"] == "ODbL-1.0"
    assert "OpenStreetMap contributors" in entry["attribution"]


@pytest.mark.parametrize("as_polygon", [False, True])
def test_resolved_site_loads_as_the_same_site(
    write_site: Write, tmp_path: Path, as_polygon: bool
) -> None:
    fields = site_fields()
    if as_polygon:
        ring = [[13.399, 52.499], [13.401, 52.499], [13.4, 52.501], [13.399, 52.499]]
        fields["region"] = {"polygon": {"type": "Polygon", "coordinates": [ring]}}
    first = load_site(write_site(fields))
    resolved = first.resolved()
    assert str(tmp_path) not in yaml.safe_dump(resolved)
    second = load_site(write_site(resolved))
    assert shapely.hausdorff_distance(first.region, second.region) < 1e-3
    assert second.traffic == first.traffic
    assert second.rig == first.rig
    assert second.resolved().keys() == resolved.keys()


def test_origins_are_kept_and_wrong_ones_named_by_their_place(write_site: Write) -> None:
    fields = site_fields()
    fields["geometry"] = [{"url": "https://h/t.json", "origins": ["https://tiles.example:8443"]}]
    fields["imagery"] = [{"xyz": "http://h/{z}/{x}/{y}", "origins": ["http://127.0.0.1:81"]}]
    resolved = load_site(write_site(fields)).resolved()
    assert resolved["geometry"] == fields["geometry"]
    assert resolved["imagery"][0]["origins"] == ["http://127.0.0.1:81"]
    fields["imagery"][0]["origins"] = ["http://h:81", "h/path"]
    with pytest.raises(InputError, match=r"imagery\[0\]\.origins\[1\].*is 'h/path', which is no"):
        load_site(write_site(fields))
    fields["imagery"][0]["origins"] = "http://h:81"
    with pytest.raises(InputError, match=r"imagery\[0\]\.origins .*a list"):
        load_site(write_site(fields))
    fields["imagery"] = []
    fields["geometry"][0]["origins"] = ["http://h:81"]
    with pytest.raises(InputError, match=r"geometry\[0\].*the origin 'http://h:81' of http"):
        load_site(write_site(fields))


def test_extract_without_roads_or_far_away_is_refused(write_site: Write, tmp_path: Path) -> None:
    site = load_site(write_site(site_fields()))
    (tmp_path / "bare.osm").write_text(OSM.replace('"highway"', '"waterway"'))
    with pytest.raises(InputError, match=r"bare\.osm: holds no roads"):
        check_extract(site, read_extract(tmp_path / "bare.osm"))
    # The same streets 0.3 degrees further north, and on the other side of the world.
    (tmp_path / "north.osm").write_text(OSM.replace('lat="52.', 'lat="52.8'))
    extract = read_extract(tmp_path / "north.osm")
    with pytest.raises(InputError, match=r"no road within the region") as caught:
        check_extract(site, extract)
    away = min(
        Geod(ellps="WGS84").inv(LONGITUDE, LATITUDE, *extract.nodes[node])[2]
        for node in extract.nodes
    )
    said = float(str(caught.value).split("nearest is ")[1].split(" km")[0])
    assert said == pytest.approx(away / 1000, abs=0.2)
    (tmp_path / "far.osm").write_text(OSM.replace('lon="13.', 'lon="-163.'))
    with pytest.raises(
        InputError, match=r"nearest is \d{4}\.\d km away from it; expected an extract"
    ):
        check_extract(site, read_extract(tmp_path / "far.osm"))
