"""Rigs: the same place said in two ways, and what is refused."""

import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site import Effects, SensorSpec, load_rig_spec

from ..thorough import further
from .conftest import LATITUDE, LONGITUDE, SENSOR


def write(folder: Path, *sensors: dict[str, Any], **fields: Any) -> Path:
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump({**fields, "sensors": list(sensors)}, sort_keys=False))
    return path


def test_defaults(tmp_path: Path) -> None:
    rig = load_rig_spec(write(tmp_path, SENSOR))
    assert (rig.rate_hz, rig.frame) == (10.0, "level")
    sensor = rig.sensors[0]
    assert (sensor.yaw_deg, sensor.pitch_deg, sensor.roll_deg) == (0.0, 0.0, 0.0)
    assert sensor.effects.noise
    assert sensor.effects.dropout
    assert sensor.columns is None


def test_place_by_latitude_and_longitude(tmp_path: Path) -> None:
    # 120 m from the anchor at an azimuth of 30 degrees: sin and cos of it are east and north.
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(LONGITUDE, LATITUDE, 30.0, 120.0)
    sensor = {k: v for k, v in SENSOR.items() if k not in ("east_m", "north_m")}
    path = write(tmp_path, sensor | {"latitude": latitude, "longitude": longitude})
    placed = load_rig_spec(path, SiteFrame(LATITUDE, LONGITUDE)).sensors[0]
    assert placed.east_m == pytest.approx(60.0, abs=1e-3)
    assert placed.north_m == pytest.approx(103.923, abs=1e-3)
    with pytest.raises(InputError, match=r"sensors\[0\].*without a site; expected east_m"):
        load_rig_spec(path)


def placed(folder: Path, **fields: Any) -> SensorSpec:
    rest = {key: value for key, value in SENSOR.items() if key not in ("yaw_deg", "pitch_deg")}
    rig = load_rig_spec(write(folder, rest | fields), SiteFrame(LATITUDE, LONGITUDE))
    return rig.sensors[0]


@pytest.mark.parametrize("heading", [0.0, 45.0, 90.0, 181.0, 270.0, 360.0])
def test_heading_is_clockwise_from_north(tmp_path: Path, heading: float) -> None:
    """As a geodesic of that azimuth goes in the site's plane."""
    frame = SiteFrame(LATITUDE, LONGITUDE)
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(LONGITUDE, LATITUDE, heading, 50.0)
    east, north = frame.site_from_lonlat([[longitude, latitude]])[0]
    yaw = math.radians(placed(tmp_path, heading_deg=heading).yaw_deg)
    assert 50.0 * math.cos(yaw) == pytest.approx(east, abs=1e-3)
    assert 50.0 * math.sin(yaw) == pytest.approx(north, abs=1e-3)


def test_tilt_is_down(tmp_path: Path) -> None:
    assert placed(tmp_path, tilt_deg=12).pitch_deg == 12.0


def test_heights_in_three_ways(tmp_path: Path) -> None:
    for name in ("height_m", "up_m", "altitude_m"):
        sensor = placed(tmp_path, **{"height_m": None, name: 6.5})
        given = {field: getattr(sensor, field) for field in ("height_m", "up_m", "altitude_m")}
        assert given == {"height_m": None, "up_m": None, "altitude_m": None} | {name: 6.5}


FULL: dict[str, Any] = {
    "rate_hz": 10.0,
    "conditions": {"weather": "rain", "visibility_m": 300.0, "sun_elevation_deg": 20.0},
    "sway": {"rms_m": 0.01},
    "fused": False,
}
TIMED = {
    "returns": "dual",
    "rate_hz": 20.0,
    "phase_deg": 90.0,
    "phase_lock": False,
    "clock_offset_s": -0.01,
    "clock_drift_ppm": 12.5,
    "time_jitter_s": 0.001,
    "latency_s": 0.05,
    "dropped_frames": 0.02,
    "outages": [{"sector_deg": [10, 20], "channels": ["0-3", 9], "start_s": 1, "stop_s": 2.5}],
    "effects": {"noise": False},
}


@pytest.mark.parametrize("rides", [False, True])
def test_a_rig_that_is_written_loads_as_the_same(tmp_path: Path, rides: bool) -> None:
    sensor, fields = SENSOR | TIMED, dict(FULL)
    if rides:
        sensor = {"name": "a", "model": "OS1-64", "forward_m": 1, "left_m": 0, "above_roof_m": 0.2}
        sensor |= TIMED | {"yaw_deg": -90, "tilt_deg": 3}
        fields = {k: v for k, v in FULL.items() if k != "sway"} | {"ride": {"class": "bus"}}
    rig = load_rig_spec(write(tmp_path, sensor, **fields))
    (tmp_path / "again").mkdir()
    path = tmp_path / "again" / "rig.yaml"
    path.write_text(yaml.safe_dump(rig.written(), sort_keys=False))
    assert load_rig_spec(path) == rig
    assert rig.sensors[0].outages[0].channels == [0, 1, 2, 3, 9]
    assert rig.conditions.weather == "rain"
    assert rig.standing() == ([] if rides else [("pole", SENSOR["east_m"], SENSOR["north_m"])])


def test_all_effects_off_at_once(tmp_path: Path) -> None:
    assert placed(tmp_path, effects=False).effects == Effects.none()
    assert placed(tmp_path, effects=True).effects == Effects()


FRAME = SiteFrame(LATITUDE, LONGITUDE)
RIDER = {"name": "a", "model": "OS1-128", "forward_m": 0.0, "left_m": 0.0, "height_m": 2.0}
RIDE: dict[str, Any] = {"ride": {"track": 3}}
BY_DEGREES = {"name": "a", "model": "OS1-128", "height_m": 5.0}
BAD: dict[str, tuple[list[dict[str, Any]], dict[str, Any], str]] = {
    "two of a name": ([SENSOR, SENSOR], {}, "2 sensors are named 'pole'"),
    "name with a slash": ([SENSOR | {"name": "a/b"}], {}, "'a/b' cannot name files"),
    "no model": ([{"name": "a"}], {}, r"sensors\[0\].model .*is missing"),
    "no columns": ([SENSOR | {"columns": 0}], {}, r"columns .*is 0; expected more than 0"),
    "half a column": ([SENSOR | {"columns": 1.5}], {}, "is 1.5; expected a whole number"),
    "height nan": ([SENSOR | {"height_m": float("nan")}], {}, "is nan; expected a finite"),
    "height zero": ([SENSOR | {"height_m": 0}], {}, "0 m is under the ground"),
    "out of sight": ([SENSOR | {"east_m": 1e5}], {}, r"east_m .*expected at most 2000"),
    "head over": ([SENSOR | {"pitch_deg": 120}], {}, r"pitch_deg .*at most 90"),
    "rate": ([SENSOR], {"rate_hz": 0}, r"rate_hz \(line 1\).*more than 0"),
    "frame": ([SENSOR], {"frame": "world"}, "'sensor', 'level' or 'site'"),
    "effect": ([SENSOR | {"effects": {"rain": True}}], {}, r"effects\.rain .*noise, dropout"),
    "effect not a switch": ([SENSOR | {"effects": {"noise": 0.1}}], {}, "true or false"),
    "placed twice": ([SENSOR | {"latitude": 1.0}], {}, r"sensors\[0\] .*is placed twice"),
    "half placed": ([BY_DEGREES | {"latitude": LATITUDE}], {}, "longitude is missing"),
    "bad degrees": ([BY_DEGREES | {"latitude": 99, "longitude": 13}], {}, "99 is out of range"),
    "overseas": ([BY_DEGREES | {"latitude": 0, "longitude": -90}], {}, "more than 100 km away"),
    "two headings": ([SENSOR | {"yaw_deg": 1, "heading_deg": 3}], {}, "both yaw_deg and heading"),
    "two tilts": ([SENSOR | {"pitch_deg": 1, "tilt_deg": 3}], {}, "both pitch_deg and tilt_deg"),
    "tilt over": ([BY_DEGREES | {"east_m": 0, "tilt_deg": 91}], {}, "tilt_deg 91 is out of range"),
    "heading nan": ([BY_DEGREES | {"heading_deg": float("nan")}], {}, "heading_deg nan is out of"),
    "no place": ([BY_DEGREES], {}, r"sensors\[0\].* has no place; expected east_m and north_m"),
    "no north": ([BY_DEGREES | {"east_m": 1.0}], {}, "has no place"),
    "no height": (
        [SENSOR | {"height_m": None}],
        {},
        "has no height; expected one of",
    ),
    "two heights": ([SENSOR | {"up_m": 3.0}], {}, "has 2 heights"),
    "roof of what": (
        [SENSOR | {"height_m": None, "above_roof_m": 1}],
        {},
        "above_roof_m, which is for the other",
    ),
    "effects all": ([SENSOR | {"effects": "none"}], {}, "expected a mapping of fields"),
    "returns": ([SENSOR | {"returns": "all"}], {}, "'strongest', 'last', 'first' or 'dual'"),
    "drops": ([SENSOR | {"dropped_frames": 1.5}], {}, "at most 1"),
    "sector": ([SENSOR | {"outages": [{"sector_deg": [1]}]}], {}, r"outages\[0\].sector_deg"),
    "channels": ([SENSOR | {"outages": [{"channels": ["3-1"]}]}], {}, "'3-1' is not a span of"),
    "channels huge": ([SENSOR | {"outages": [{"channels": ["0-99999999"]}]}], {}, "is not a span"),
    "ends before": ([SENSOR | {"outages": [{"start_s": 4, "stop_s": 3}]}], {}, "ends at 3 s"),
    "weather": ([SENSOR], {"conditions": {"weather": "hail"}}, "'clear', 'rain', 'fog' or 'snow'"),
    "no visibility": ([SENSOR], {"conditions": {"visibility_m": 0}}, "more than 0"),
    "sway": ([SENSOR], {"sway": {"rms_m": -1}}, r"sway.rms_m .*at least 0"),
    "window": ([SENSOR], {"window_s": 0.5}, "window_s .*is 0.5; expected at most 0.1"),
    "stands on a ride": (
        [SENSOR],
        RIDE,
        "is placed on the site, but its rig is mounted on a vehicle",
    ),
    "rides a pole": ([RIDER], {}, "is placed on a vehicle, but its rig stands"),
    "both": ([SENSOR | {"forward_m": 1.0}], RIDE, "is placed twice"),
    "half on it": ([RIDER | {"left_m": None}], RIDE, "has half a place on its vehicle"),
    "heading on it": ([RIDER | {"heading_deg": 0}], RIDE, "heading_deg on a vehicle"),
    "ride nothing": ([RIDER], {"ride": {}}, "does not name one carrier"),
    "ride two": ([RIDER], {"ride": {"track": 1, "class": "car"}}, "does not name one carrier"),
    "ride a dog": ([RIDER], {"ride": {"class": "dog"}}, "'dog'; expected one of car, truck, bus"),
    "ride and sway": ([RIDER], RIDE | {"sway": {"rms_m": 0.1}}, "sway .*is for poles"),
    "one is bad": ([SENSOR, SENSOR | {"height_m": "x"}], {}, r"sensors\[1\]\.height_m \(line 1"),
}


NESTED = ("sensors: {}", "sensors:\n- outages: {}", "conditions: {}")


@pytest.mark.parametrize(("sensors", "fields", "words"), BAD.values(), ids=BAD.keys())
def test_bad_rig_is_named(
    tmp_path: Path, sensors: list[dict[str, Any]], fields: dict[str, Any], words: str
) -> None:
    path = write(tmp_path, *sensors, **fields)
    with pytest.raises(InputError, match=words) as caught:
        load_rig_spec(path, FRAME)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("kind", "depth"),
    [
        *((kind, depth) for kind in NESTED for depth in (100, 300)),
        (NESTED[0], 100_000),
        *further(*((kind, depth) for kind in NESTED[1:] for depth in (2000, 100_000))),
    ],
)
def test_a_file_that_is_nested_very_deep(tmp_path: Path, depth: int, kind: str) -> None:
    path = tmp_path / "rig.yaml"
    for start, stop in ("[]", ("{a: ", "}")):
        path.write_text(kind.format(start * depth + "1" + stop * depth) + "\n")
        with pytest.raises(InputError) as caught:
            load_rig_spec(path)
        assert len(str(caught.value)) < 300 + len(str(path))
