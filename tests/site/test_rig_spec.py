"""Rigs: the same place said in two ways, and what is refused."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site import load_rig_spec

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


FRAME = SiteFrame(LATITUDE, LONGITUDE)
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
    "one is bad": ([SENSOR, SENSOR | {"height_m": "x"}], {}, r"sensors\[1\]\.height_m \(line 1"),
}


@pytest.mark.parametrize(("sensors", "fields", "words"), BAD.values(), ids=BAD.keys())
def test_bad_rig_is_named(
    tmp_path: Path, sensors: list[dict[str, Any]], fields: dict[str, Any], words: str
) -> None:
    path = write(tmp_path, *sensors, **fields)
    with pytest.raises(InputError, match=words) as caught:
        load_rig_spec(path, FRAME)
    assert str(caught.value).startswith(f"{path}: ")
