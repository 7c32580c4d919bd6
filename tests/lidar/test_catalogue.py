"""The catalogue against the makers' own tables and against what real sensors measured."""

import csv
import json
import pickle
from dataclasses import fields

import numpy as np
import pytest
import scipy.io
import yaml
from pyarrow import feather

from urbantwin.errors import InputError
from urbantwin.lidar import Sensor, load_sensor, nominal_sensor_names, sensor, sensor_names
from urbantwin.lidar.sensor_file import sensor_document

from ..real_files import SWEEPS, argoverse_log

VELODYNE = {
    "VLP-16": "VLP16db.yaml",
    "VLP-16-Hi-Res": "VLP16_hires_db.yaml",
    "HDL-32E": "32db.yaml",
    "VLP-32C": "VeloView-VLP-32C.yaml",
    "HDL-64E": "64e_s3-xiesc.yaml",
    "HDL-64E-S2": "64e_s2.1-sztaki.yaml",
    "VLS-128": "VLS128.yaml",
}
HESAI = {
    "Pandar40P": "Pandar40P",
    "Pandar64": "Pandar64",
    "PandarQT": "PandarQT",
    "PandarXT-16": "PandarXT-16",
    "PandarXT-32": "PandarXT",
    "Pandar128": "Pandar128E3X",
    "QT128": "QT128C2X",
    "OT128": "OT128",
    "OT128-40": "OT128_40",
    "Pandar40M": "Pandar40M",
    "Pandar90": "Pandar90E3X",
    "XT32M2X": "XT32M2X",
    "JT128": "JT128",
    "JT16": "JT16",
}
FIRING = {  # file, column of times, factor to microseconds
    "Pandar40P": ("Pandar40P", 1, 1),
    "Pandar64": ("Pandar64", 1, 1),
    "PandarQT": ("PandarQT", 1, 1),
    "PandarXT-16": ("PandarXT-16", 1, 1),
    "PandarXT-32": ("PandarXT-32", 1, 1),
    "XT32M2X": ("PandarXT-32M2X", 1, 1),
    "JT128": ("JT128", 1, 1),
    "OT128": ("OT128", 5, 1),
    "Pandar128": ("Pandar128E3X", 9, 1e-3),
    "Pandar90": ("Pandar90", 9, 1e-3),
}
OUSTER = {
    "OS0-32": ("OS-0-32-U1_v2.2.0_1024x10.json", 1),
    "OS1-32": ("OS-1-32-G_v2.1.1_1024x10.json", 1),
    "OS2-32": ("OS-2-32-U0_v2.0.0_1024x10.json", 1),
    "OS0-128": ("OS-0-128-U1_v2.3.0_1024x10.json", 1),
    "OS0-64": ("OS-0-128-U1_v2.3.0_1024x10.json", 2),
    "OS1-128": ("OS-1-128_v2.3.0_1024x10.json", 1),
    "OS1-64": ("2_0_0_os1-991913000010-64.json", 1),
    "OS2-128": ("OS-2-128-U1_v2.3.0_1024x10.json", 1),
    "OS2-64": ("OS-2-128-U1_v2.3.0_1024x10.json", 2),
}


def assert_table(name, elevation, offset):
    lidar = sensor(name)
    assert lidar.channels == len(elevation)
    assert np.abs(lidar.elevation_deg - elevation).max() < 1e-3
    assert np.abs(lidar.azimuth_offset_deg - offset).max() < 1e-3


@pytest.mark.parametrize(("name", "file"), VELODYNE.items())
def test_velodyne_tables(shared_data, name, file):
    lasers = yaml.safe_load((shared_data / "sensors/velodyne" / file).read_text())["lasers"]
    table = {laser["laser_id"]: laser for laser in lasers}
    rows = [table[number] for number in range(len(table))]
    # The driver looks along sin/cos(encoder - rot_correction) with y forward and x right, so in
    # a counter-clockwise frame the correction keeps its sign.
    assert_table(
        name,
        np.degrees([row["vert_correction"] for row in rows]),
        np.degrees([row["rot_correction"] for row in rows]),
    )


@pytest.mark.parametrize(("name", "file"), HESAI.items())
def test_hesai_tables(shared_data, name, file):
    folder = shared_data / "sensors/hesai_sdk2/angle_correction"
    path = folder / f"{file}_Angle_Correction_File.csv"
    with path.open(encoding="utf-8-sig") as stream:
        table = {
            int(row[0]): (float(row[1]), float(row[2]))
            for row in csv.reader(stream)
            if row[0].strip().isdigit() and row[2:] > [""]
        }
    rows = np.array([table[number] for number in range(1, len(table) + 1)])
    # Hesai's azimuth grows clockwise.
    assert_table(name, rows[:, 0], (180 - rows[:, 1]) % 360 - 180)


@pytest.mark.parametrize(("name", "row"), FIRING.items())
def test_hesai_firing_times(shared_data, name, row):
    file, column, factor = row
    folder = shared_data / "sensors/hesai_sdk2/firetime_correction"
    text = (folder / f"{file}_Firetime_Correction_File.csv").read_text("utf-8-sig")
    cells = [line.split(",") for line in text.splitlines()]
    # Headers of the long tables begin with the distance 2.85, which is no channel.
    table = {int(row[0]): float(row[column]) for row in cells if row[0].isdigit()}
    expected = [table[number] * factor for number in range(1, len(table) + 1)]
    assert sensor(name).firing_time_us == pytest.approx(expected, abs=1e-3)


def test_velodyne_firing_times_are_those_of_the_manuals():
    """VLP-16 manual 9.4: 2.304 us apart, the last at 34.56 us of 55.296 (figure 9-8)."""
    assert sensor("VLP-16").firing_time_us[[0, 1, 15]] == pytest.approx([0, 2.304, 34.56])
    # VLP-32C manual 9.5: lasers fire in pairs.
    assert sensor("VLP-32C").firing_groups == 16
    # VLS-128 manual 9.3.1.1: groups of eight.
    assert sensor("VLS-128").firing_groups == 16
    assert sensor("VLP-32C").blocks == tuple((n, n + 1) for n in range(0, 32, 2))
    assert sensor("VLS-128").blocks == tuple(tuple(range(n, n + 8)) for n in range(0, 128, 8))
    for name in ("VLP-16", "VLP-32C", "HDL-32E", "HDL-64E-S2", "VLS-128"):
        lidar = sensor(name)
        assert lidar.firing_time_us.min() >= 0
        assert lidar.firing_time_us.max() < lidar.firing_sequence_us
        # One turn over its columns is one sequence, where the columns are the firings.
        if name.startswith("HDL"):
            assert 1e6 / lidar.column_rate_hz == pytest.approx(lidar.firing_sequence_us, rel=2e-3)


@pytest.mark.parametrize("name", OUSTER)
def test_ouster_tables(shared_data, name):
    file, step = OUSTER[name]
    metadata = json.loads((shared_data / "sensors/ouster" / file).read_text())
    beams = metadata.get("beam_intrinsics", metadata)
    assert_table(
        name,
        np.array(beams["beam_altitude_angles"])[::step],
        -np.array(beams["beam_azimuth_angles"])[::step],
    )


def test_every_sensor_of_the_catalogue_is_compared_with_a_real_table():
    assert {*VELODYNE, *HESAI, *OUSTER} == set(sensor_names())


def test_what_is_below_the_horizon_is_the_lower_half_of_a_real_table(shared_data):
    metadata = json.loads((shared_data / "sensors/ouster/OS-1-128_v2.3.0_1024x10.json").read_text())
    beams = metadata.get("beam_intrinsics", metadata)
    assert_table(
        "OS1-64-BH",
        np.array(beams["beam_altitude_angles"])[64:],
        -np.array(beams["beam_azimuth_angles"])[64:],
    )


def test_nobody_takes_a_nominal_table_for_a_real_one():
    nominal = nominal_sensor_names()
    assert not set(nominal) & set(sensor_names())
    for name in nominal:
        lidar = sensor(name)
        said = lidar.sources.get("elevation_deg") or lidar.unknown["elevation_deg"]
        assert said.startswith(("nominal", "assumed")), name


def test_vls_128_elevations_are_those_of_a_real_roadside_unit(shared_data):
    path = shared_data / "lidar/newbrunswick-roadside/beams_elevation.mat"
    measured = next(v for k, v in scipy.io.loadmat(path).items() if not k.startswith("__"))
    ours = np.sort(sensor("VLS-128").elevation_deg)
    assert np.abs(np.sort(np.degrees(measured.ravel())) - ours).max() < 1e-3


def test_azimuth_offsets_have_the_sign_that_a_real_vlp_32c_shows(shared_data):
    """Points of the upright VLP-32C of an Argoverse 2 sweep.

    Take the encoder's turn (known from the firing times) off their azimuths: what is left is each
    channel's own offset, counter-clockwise in the sensor's frame.
    """
    folder = argoverse_log(shared_data)
    pose = feather.read_table(folder / "calibration/egovehicle_SE3_sensor.feather").to_pydict()
    row = pose["sensor_name"].index("up_lidar")
    assert pose["qw"][row] > 0.9999  # upright: a translation is all that is needed
    origin = [pose[axis][row] for axis in ("tx_m", "ty_m", "tz_m")]
    sweep = feather.read_table(folder / SWEEPS[0])
    laser = sweep["laser_number"].to_numpy()
    points = np.column_stack([sweep[axis].to_numpy().astype(float) for axis in "xyz"]) - origin
    range_m = np.linalg.norm(points, axis=1)
    keep = (laser < 32) & (range_m > 15) & (range_m < 60)
    laser, points, range_m = laser[keep], points[keep], range_m[keep]
    time_s = sweep["offset_ns"].to_numpy()[keep] * 1e-9
    elevation = np.degrees(np.arcsin(points[:, 2] / range_m))
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    turns = [
        np.exp(1j * (azimuth + 2 * np.pi * rate * time_s)) for rate in np.arange(9.9, 10.1, 0.002)
    ]
    turn = max(turns, key=lambda each: abs(each.mean()))
    residual = np.angle(turn * np.conj(turn.mean()), deg=True)

    lidar, compared = sensor("VLP-32C"), 0
    for number in range(32):
        mine = laser == number
        if mine.sum() < 200:
            continue
        channel = int(np.argmin(np.abs(lidar.elevation_deg - np.median(elevation[mine]))))
        if abs(lidar.elevation_deg[channel] - np.median(elevation[mine])) > 0.1:
            continue
        assert np.median(residual[mine]) == pytest.approx(
            lidar.azimuth_offset_deg[channel], abs=0.3
        )
        compared += 1
    assert compared >= 20


@pytest.mark.parametrize("name", [*sensor_names(), *nominal_sensor_names()])
def test_every_known_number_names_its_source_and_every_other_a_reason(name):
    lidar = sensor(name)
    fields = [
        "modes",
        "firing_time_us",
        "firing_sequence_us",
        "azimuth_step_deg",
        "beam_divergence_deg",
        "beam_origin_m",
        "return_modes",
        "intensity_scale",
        "intensity_of_white",
        "intensity_max",
        "detection_range_10_m",
        "detection_range_80_m",
        "elevation_deg",
        "azimuth_offset_deg",
        "columns",
        "columns_options",
        "rate_hz",
        "rate_options",
        "range_min_m",
        "range_max_m",
        "reference_reflectivity",
        "reference_range_m",
        "range_sigma_m",
        "range_resolution_m",
        "wavelength_nm",
        "spin",
    ]
    for field in fields:
        assert (field in lidar.sources) != (field in lidar.unknown), field
        assert len(lidar.sources.get(field) or lidar.unknown[field]) > 10, field
        if getattr(lidar, field) is None:
            assert field in lidar.unknown, field
        elif field in lidar.unknown:
            assert lidar.unknown[field].startswith("assumed"), field


@pytest.mark.parametrize("name", [*sensor_names(), *nominal_sensor_names()])
def test_numbers_are_physical(name):
    lidar = sensor(name)
    assert 800 <= lidar.assumed_wavelength_nm <= 1600
    assert 0 < lidar.assumed_range_min_m < lidar.assumed_range_max_m <= 300
    assert 0 < lidar.assumed_range_sigma_m <= 0.1
    assert 0 < lidar.assumed_range_resolution_m <= 0.02
    reflectivity, range_m = lidar.assumed_reference
    assert 0 < reflectivity <= 1
    assert range_m <= lidar.assumed_range_max_m
    assert np.unique(lidar.elevation_deg).size > lidar.channels / 2
    ten, eighty = lidar.detection_range_10_m, lidar.detection_range_80_m
    # Returns fall with the square of the range, so 80 % reach sqrt(8) = 2.83 times as far at most.
    assert ten is None or eighty is None or 1 < eighty / ten < 3.1
    assert lidar.modes is None or (lidar.columns, lidar.rate_hz) in lidar.modes
    for columns, rate in lidar.modes or ():
        assert columns in lidar.columns_options
        assert rate in lidar.rate_options
    for angle in lidar.beam_divergence_deg or ():
        assert 0.02 < angle < 0.5


def test_the_names_that_people_use_are_there():
    wanted = ["VLP-16", "VLP-32C", "HDL-64E", "VLS-128", "Pandar64", "PandarQT", "OT128"]
    wanted += [f"OS{series}-{beams}" for series in (0, 1, 2) for beams in (64, 128)]
    assert set(wanted) <= set(sensor_names())


@pytest.mark.parametrize("spelling", ["os1-128", "OS1128", "OS1 128", "os1_128", "Os-1-128"])
def test_spelling_is_forgiven(spelling):
    assert sensor(spelling).name == "OS1-128"


def test_aliases_lead_to_the_same_sensor():
    assert sensor("Alpha Prime") is sensor("VLS-128")
    assert sensor("xt32") is sensor("PandarXT-32")


def test_an_unknown_name_lists_near_ones():
    with pytest.raises(InputError, match=r"unknown sensor 'OS1-127'.*OS1-128"):
        sensor("OS1-127")
    with pytest.raises(InputError, match=r"expected one of .*VLP-16"):
        sensor("???")


OWN = """
name: Two
maker: me
columns: 4
columns_options: [4]
rate_hz: 10
rate_options: [10]
range_min_m: null
range_max_m: 80
reference_reflectivity: null
reference_range_m: null
range_sigma_m: null
range_resolution_m: null
wavelength_nm: null
channels: [[0, 0], [-1.5, 2]]
"""


def test_a_persons_own_file_works_and_falls_back(tmp_path):
    path = tmp_path / "two.yaml"
    path.write_text(OWN)
    mine = sensor(path)
    assert mine.name == "Two"
    assert mine.elevation_deg.tolist() == [0, -1.5]
    assert mine.azimuth_offset_deg.tolist() == [0, 2]
    assert mine.spin == "cw"
    assert mine.assumed_reference == (0.1, 40)
    assert load_sensor(path).channels == 2


@pytest.mark.parametrize("name", [name for name in sensor_names() if not sensor(name).pattern])
def test_a_sensor_written_as_its_file_is_read_as_it_was(tmp_path, name):
    """Every field of it, whichever there are."""
    path = tmp_path / "unit.yaml"
    path.write_text(yaml.safe_dump(sensor_document(sensor(name))))
    again = sensor(path)
    for field in fields(Sensor):
        np.testing.assert_equal(getattr(again, field.name), getattr(sensor(name), field.name))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("columns: 4\n", "columns: -4\n", "columns"),
        ("columns: 4\n", "columns: 5\n", "columns_options"),
        ("range_max_m: 80", "range_max_m: .nan", "range_max_m"),
        ("[-1.5, 2]", "[-91, 2]", r"channels\.1\.0"),
        ("channels: [[0, 0], [-1.5, 2]]", "channels: []", "channels"),
        ("maker: me", "maker: me\ncolour: red", "colour"),
        ("maker: me", "maker: [", "line"),
        ("maker: me", "maker: me\nfiring_time_us: [0]", "1 times for 2 channels"),
        ("maker: me", "maker: me\nfiring_time_us: [0, .nan]", r"firing_time_us\.1"),
        (OWN, "", "two.yaml"),
    ],
)
def test_a_wrong_file_is_named_with_its_field(tmp_path, old, new, told):
    path = tmp_path / "two.yaml"
    path.write_text(OWN.replace(old, new))
    with pytest.raises(InputError, match=told) as caught:
        sensor(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="not found"):
        sensor(str(tmp_path / "none.yaml"))


def test_a_sensor_can_be_sent_to_another_process():
    there = pickle.loads(pickle.dumps(sensor("OT128")))
    assert np.array_equal(there.elevation_deg, sensor("OT128").elevation_deg)
    assert there.sources == sensor("OT128").sources
