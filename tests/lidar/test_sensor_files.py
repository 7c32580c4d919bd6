"""Sensors from the files of real Ouster and Hesai units, and from files that are wrong."""

import csv
import json
import shutil
import time

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.lidar import beam_directions, sensor
from urbantwin.lidar.placement import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.twin.sensor_files import copy_sensor_files

OUSTER = {  # file, model that lends its ranges, beams leave the axis at (mm)
    "1_14_beta_os1-991937000062-64_legacy.json": ("OS1-64", None),
    "2_0_0_os1-991913000010-64.json": ("OS1-64", 12.163),
    "2_2_os-992119000444-128.json": ("OS1-128", 15.806),
    "3_0_1_os-122246000293-128.json": ("OS1-128", 16.721),
    "OS-0-32-U1_v2.2.0_1024x10.json": ("OS0-32", 27.67),
    "OS-2-128-U1_v2.3.0_1024x10.json": ("OS2-128", 13.762),
}
HESAI = {
    "hesai_sdk2/angle_correction/Pandar128E3X_Angle_Correction_File.csv": "Pandar128",
    "hesai_sdk2/angle_correction/JT128_Angle_Correction_File.csv": "JT128",
    "hesai_general_ros/Pandar64.csv": "Pandar64",
    "nebula/hesai/Pandar128E4X.csv": "OT128",
    "nebula/hesai/PandarXT32.csv": "PandarXT-32",
}


@pytest.mark.parametrize(("name", "row"), OUSTER.items())
def test_ouster_metadata_of_old_and_new_layout(shared_data, name, row):
    model, origin_mm = row
    path = shared_data / "sensors/ouster" / name
    document = json.loads(path.read_text())
    beams = document.get("beam_intrinsics", document)
    unit, base = sensor(path), sensor(model)
    assert unit.elevation_deg.tolist() == beams["beam_altitude_angles"]
    assert np.array_equal(unit.azimuth_offset_deg, -np.array(beams["beam_azimuth_angles"]))
    assert (unit.columns, unit.rate_hz) == (1024, 10.0)
    assert unit.beam_origin_m == (None if origin_mm is None else pytest.approx(origin_mm / 1000))
    assert unit.range_max_m == base.range_max_m
    assert unit.wavelength_nm == base.wavelength_nm
    assert name in unit.sources["elevation_deg"]
    assert ("beam_origin_m" in unit.unknown) == (origin_mm is None)


def test_metadata_with_nothing_but_angles_leaves_the_rest_unknown(shared_data):
    unit = sensor(shared_data / "sensors/ouster/OS-1-64_sensor_config_reduced.json")
    assert unit.channels == 64
    assert unit.range_max_m is None
    assert "range_max_m" in unit.unknown
    assert beam_directions(unit).shape == (64, 1024, 3)


@pytest.mark.parametrize(("name", "model"), HESAI.items())
def test_hesai_angle_corrections(shared_data, name, model):
    path = shared_data / "sensors" / name
    with path.open(encoding="utf-8-sig") as stream:
        rows = [[float(cell) for cell in row] for row in csv.reader(stream) if row[0].isdigit()]
    unit = sensor(path)
    assert unit.elevation_deg.tolist() == [row[1] for row in rows]
    clockwise = np.radians([row[2] for row in rows])
    # The same direction, whatever turns lie between.
    assert np.exp(1j * np.radians(unit.azimuth_offset_deg)) == pytest.approx(
        np.exp(-1j * clockwise)
    )
    assert unit.range_max_m == sensor(model).range_max_m
    assert unit.name == sensor(model).name


def test_a_correction_names_its_model_before_a_colon(tmp_path, shared_data):
    source = shared_data / "sensors/hesai_general_ros/Pandar64.csv"
    path = tmp_path / "unit17.csv"
    path.write_bytes(source.read_bytes())
    assert np.array_equal(sensor(f"Pandar64:{path}").elevation_deg, sensor(source).elevation_deg)
    with pytest.raises(InputError, match=r"which model.*Pandar64:unit17\.csv"):
        sensor(path)
    with pytest.raises(InputError, match=r"64 channels.*the 40 of Pandar40P"):
        sensor(f"Pandar40P:{path}")
    with pytest.raises(InputError, match="unknown sensor 'Pandar63'"):
        sensor(f"Pandar63:{path}")


def test_a_rig_takes_a_file_that_stands_beside_it(tmp_path, shared_data, street):
    name = "3_0_1_os-122246000293-128.json"
    (tmp_path / "unit.json").write_bytes((shared_data / "sensors/ouster" / name).read_bytes())
    one = {"name": "a", "model": "unit.json", "east_m": 0.0, "north_m": 0.0, "height_m": 5.0}
    rig = place_rig(RigSpec.model_validate({"sensors": [one]}), street, file=tmp_path / "rig.yaml")
    assert rig.sensors[0].sensor.elevation_deg[0] == 20.47
    assert rig.sensors[0].columns == 1024


def test_a_twin_keeps_the_files_of_its_sensors(tmp_path, shared_data, street):
    """The twin is shared, and its rig must still find them."""
    site, twin = tmp_path / "site", tmp_path / "twin"
    for folder in (site, site / "b", twin):
        folder.mkdir()
    data = shared_data / "sensors"
    (site / "unit.csv").write_bytes((data / "hesai_general_ros/Pandar64.csv").read_bytes())
    (site / "unit.json").write_bytes((data / f"ouster/{next(iter(OUSTER))}").read_bytes())
    (site / "b/unit.json").write_bytes((data / f"ouster/{list(OUSTER)[-1]}").read_bytes())
    models = ["Pandar64:unit.csv", "unit.json", "b/unit.json", "VLP-16", str(site / "unit.json")]
    place = {"east_m": 0.0, "north_m": 0.0, "height_m": 5.0}
    spec = RigSpec.model_validate(
        {"sensors": [{"name": f"s{k}", "model": m, **place} for k, m in enumerate(models)]}
    )
    kept = RigSpec.model_validate(copy_sensor_files(spec, site / "site.yaml", twin))
    wanted = [one.sensor for one in place_rig(spec, street, file=site / "site.yaml").sensors]
    shutil.rmtree(site)
    found = [one.sensor for one in place_rig(kept, street, file=twin / "rig.yaml").sensors]
    for one, other in zip(found, wanted, strict=True):
        assert np.array_equal(one.elevation_deg, other.elevation_deg)
        assert one.range_max_m == other.range_max_m
    assert len(list(twin.iterdir())) == 3
    assert not any(str(tmp_path) in one.model for one in kept.sensors)


ANGLES = {"beam_altitude_angles": [1.0, 0.0], "beam_azimuth_angles": [3.0, -3.0]}


@pytest.mark.parametrize(
    ("document", "told"),
    [
        ("", "is not JSON"),
        ("{", "line 1, column 2 .byte 1.: is not JSON"),
        ("[1]", "table of keys"),
        ("[" * 100_000, "is not JSON"),
        ("{}", "beam_altitude_angles: is missing"),
        ({**ANGLES, "beam_azimuth_angles": None}, "beam_azimuth_angles: is missing"),
        ({**ANGLES, "beam_altitude_angles": []}, "0 channels"),
        ({**ANGLES, "beam_altitude_angles": "no"}, "is not a list"),
        ({**ANGLES, "beam_altitude_angles": [1.0]}, "1 beam_altitude_angles but 2"),
        ({**ANGLES, "beam_altitude_angles": [1.0, float("nan")]}, "line 1, .*: is not JSON .*NaN"),
        ({**ANGLES, "beam_altitude_angles": [1.0, 91]}, r"angles\[1\]: 91"),
        ({**ANGLES, "beam_altitude_angles": [[1.0], [2]]}, r"angles\[0\]"),
        ({**ANGLES, "beam_altitude_angles": [True, 1]}, r"angles\[0\]"),
        ({key: [0.5] * 1_000_000 for key in ANGLES}, "1000000 channels|larger than"),
        ({**ANGLES, "lidar_mode": "fast"}, "lidar_mode: 'fast'"),
        ({**ANGLES, "lidar_mode": "0x10"}, "lidar_mode: '0x10'"),
        (
            {**ANGLES, "lidar_origin_to_beam_origin_mm": float("inf")},
            "line 1, .*: is not JSON .*Infinity",
        ),
        ({**ANGLES, "data_format": 3}, "data_format"),
        ({**ANGLES, "data_format": {"pixels_per_column": 64}}, "2 beams, but pixels_per_column 64"),
    ],
)
def test_wrong_metadata_is_one_clear_line(tmp_path, document, told):
    path = tmp_path / "unit.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    began = time.monotonic()
    with pytest.raises(InputError, match=told) as caught:
        sensor(path)
    assert time.monotonic() - began < 5
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


HEAD = "Channel,Elevation,Azimuth\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no heading"),
        ("1,2,3\n", "no heading"),
        (HEAD, "0 channels"),
        (HEAD + "1,2\n", "line 2"),
        (HEAD + "1,x,2\n", "line 2.*'1,x,2' is not"),
        (HEAD + "1,nan,2\n", "line 2.*elevation nan"),
        (HEAD + "1,2,inf\n", "line 2.*azimuth inf"),
        (HEAD + "1,95,2\n", "elevation 95"),
        (HEAD + "1,2,3\n1,2,3\n", "line 3: channel 1 comes twice"),
        (HEAD + "1,2,3\n3,2,3\n", "channel 2 is missing"),
        (HEAD + "0,2,3\n1,2,3\n", "channel 0"),
        (HEAD + "1,2,3\n", "has 1 channels.*the 64"),
        (HEAD + "".join(f"{k},0,0\n" for k in range(1, 100_001)), "more than 4096"),
        ("\0" * 50, "heading|CSV"),
    ],
)
def test_a_wrong_correction_is_one_clear_line(tmp_path, text, told):
    path = tmp_path / "Pandar64.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=told) as caught:
        sensor(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["none.json", "none.csv", "."])
def test_a_file_that_is_not_there_is_named(tmp_path, name):
    with pytest.raises(InputError, match=r"not found|unknown sensor"):
        sensor(str(tmp_path / name))


@pytest.mark.parametrize("ending", ["json", "csv", "yaml"])
def test_what_is_not_text_is_told(tmp_path, ending):
    path = tmp_path / f"Pandar64.{ending}"
    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(InputError, match="is not text"):
        sensor(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        sensor(path)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("deep.yaml", "[" * 200_000 + "]" * 200_000, "nested deeper than 32"),
        ("list.yaml", "[1, 2]", "is not a table of keys"),
        ("p.csv", "time_s,azimuth_deg,elevation_deg\n0,0,0\n", "is a scan pattern"),
        ("p.npz", "", "is a scan pattern"),
        ("a.yaml", "a: &a [x]\nb: &b [*a, *a]\nname: *b", "name"),
    ],
)
def test_what_is_no_sensor_is_told(tmp_path, name, text, told):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=told) as caught:
        sensor(path)
    assert str(caught.value).startswith(str(path))
    assert "_SensorFile" not in str(caught.value)
