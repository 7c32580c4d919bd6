"""Captures of Hesai's sensors: packets packed by the manuals from known points.

Points are those of the drivers' formula (HesaiLidar_General_ROS, ``pandarGeneral_internal.cc``)
with the makers' published angles; hydra4, a program of others, reads the same of two models.
"""

import csv

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar.catalogue import sensor

from .lidar_packets import hesai_packet, hesai_turns, write_pcap

#: Channels and blocks of a packet, and the file of published angles.
MODELS = {
    "Pandar40P": (40, 10, "hesai_general_ros/Pandar40P.csv"),
    "Pandar40M": (40, 10, "hesai_sdk2/angle_correction/Pandar40M_Angle_Correction_File.csv"),
    "Pandar64": (64, 6, "nebula/hesai/Pandar64.csv"),
    "PandarQT": (64, 4, "hesai_general_ros/PandarQT.csv"),
    "PandarXT-16": (16, 8, "hesai_general_ros/PandarXT-16.csv"),
    "PandarXT-32": (32, 8, "nebula/hesai/PandarXT32.csv"),
    "XT32M2X": (32, 6, "hesai_sdk2/angle_correction/XT32M2X_Angle_Correction_File.csv"),
    "QT128": (128, 2, "nebula/hesai/PandarQT128.csv"),
    "Pandar128": (128, 2, "hesai_sdk2/angle_correction/Pandar128E3X_Angle_Correction_File.csv"),
    "Pandar90": (90, 2, "hesai_sdk2/angle_correction/Pandar90E3X_Angle_Correction_File.csv"),
    "OT128": (128, 2, "nebula/hesai/Pandar128E4X.csv"),
}
ALIKE = ("Pandar40P", "Pandar40M", "Pandar128", "OT128")
DUAL, STRONGEST = 0x39, 0x37


def turn_of(azimuth, steps, intensity, *, number=1, start=180.0):
    """Return azimuth, steps and intensity of one turn."""
    of_turn = (start + np.arange(len(azimuth)) * ((azimuth[1] - azimuth[0]) % 360)) // 360 == number
    return azimuth[of_turn], steps[of_turn], intensity[of_turn]


def by_driver(azimuth_deg, steps, elevation_deg, offset_deg):
    """Return x to the right, y forward, z up of the points of firings, one after the other."""
    firing, channel = np.nonzero(steps)
    range_m = steps[firing, channel] * 0.004
    turn = np.radians(azimuth_deg[firing] + offset_deg[channel])
    up = np.radians(elevation_deg[channel])
    flat = range_m * np.cos(up)
    points = np.column_stack([flat * np.sin(turn), flat * np.cos(turn), range_m * np.sin(up)])
    return points, firing, channel


def published(path):
    """Return elevation and azimuth of each channel of a published file."""
    lines = path.read_text().splitlines()
    begin = next(k for k, line in enumerate(lines) if "levation" in line)
    rows = [row[:3] for row in csv.reader(lines[begin + 1 :]) if len(row) >= 3 and row[1].strip()]
    table = np.array(sorted((int(n), float(up), float(turn)) for n, up, turn in rows))
    return table[:, 1], table[:, 2]


@pytest.mark.parametrize("returns", [1, 2])
@pytest.mark.parametrize("model", MODELS)
def test_points_of_every_model(tmp_path, shared_data, model, returns):
    channels, blocks, angles = MODELS[model]
    packets, *every = hesai_turns(
        model, channels, blocks, returns=returns, mode=DUAL if returns == 2 else STRONGEST
    )
    write_pcap(tmp_path / "a.pcap", packets)
    (tmp_path / "a.csv").write_bytes((shared_data / "sensors" / angles).read_bytes())
    recording = open_recording(tmp_path / "a.pcap")
    assert (recording.layout, recording.names) == ("hesai", ("1",))
    assert any("two returns" in note for note in recording.notes) == (returns == 2)
    assert any("a.csv" in note for note in recording.notes)
    frame = recording.read(0)
    azimuth, steps, intensity = turn_of(*every)
    expected, firing, channel = by_driver(
        azimuth, steps, *published(shared_data / "sensors" / angles)
    )
    np.testing.assert_allclose(frame.points[:, 0], expected[:, 1], atol=1e-9)  # forward
    np.testing.assert_allclose(frame.points[:, 1], -expected[:, 0], atol=1e-9)  # to the left
    np.testing.assert_allclose(frame.points[:, 2], expected[:, 2], atol=1e-9)
    np.testing.assert_array_equal(frame.ring, channel)
    np.testing.assert_array_equal(frame.column, firing)
    np.testing.assert_array_equal(frame.intensity, intensity[firing, channel])
    assert 0.09 < frame.time_s.max() < 0.11


@pytest.mark.parametrize("model", ["Pandar64", "PandarXT-32", "QT128"])
def test_times_are_those_of_the_firings(tmp_path, model):
    """At the sensor's own pace every block is a period after the one before."""
    channels, blocks, _ = MODELS[model]
    columns = {"Pandar64": 1800, "PandarXT-32": 2000, "QT128": 900}[model]
    packets, *_ = hesai_turns(model, channels, blocks, columns=columns, turns=1.6)
    write_pcap(tmp_path / "a.pcap", packets)
    frame = open_recording(tmp_path / "a.pcap").read(0)
    fired = sensor(model).firing_time_us[frame.ring] * 1e-6
    expected = frame.column * 0.1 / columns + fired
    # Packets count microseconds.
    np.testing.assert_allclose(frame.time_s - frame.time_s[0], expected - expected[0], atol=3e-6)


@pytest.mark.parametrize("dual", [False, True])
@pytest.mark.parametrize("model", ["PandarXT-32", "OT128"])
def test_hydra4_reads_the_same(tmp_path, judge, shared_data, model, dual):
    channels, blocks, angles = MODELS[model]
    known = {"columns": 80, "turns": 1.0, "start": 0.0}
    if dual:
        known |= {"returns": 2, "mode": DUAL}
    packets, *_ = hesai_turns(model, channels, blocks, **known)
    write_pcap(tmp_path / "a.pcap", packets)
    (tmp_path / "a.csv").write_bytes((shared_data / "sensors" / angles).read_bytes())
    frame = open_recording(tmp_path / "a.pcap").read(0)
    job = {
        "model": model, "dual": dual, "angles": str(tmp_path / "a.csv"),
        "packets": [one.hex() for one in packets],
    }  # fmt: skip
    told = np.array(judge("hesai_points", job=job))
    assert len(told) == len(frame.points) > 1000
    np.testing.assert_allclose(frame.points, told[:, [1, 0, 2]] * [1, -1, 1], atol=1e-6)
    np.testing.assert_array_equal(frame.intensity, told[:, 3])
    np.testing.assert_array_equal(frame.ring, told[:, 4])


def test_a_turn_either_way_and_of_a_sector(tmp_path):
    channels, blocks, _ = MODELS["PandarXT-16"]
    _, azimuth, steps, intensity = hesai_turns("PandarXT-16", channels, blocks, turns=2.5, start=0)
    everywhere, sector = np.ones(len(azimuth), bool), (azimuth >= 20) & (azimuth < 92)
    for name, angle, kept in (("back", 359.5 - azimuth, everywhere), ("sector", azimuth, sector)):
        rows = np.flatnonzero(kept)
        rows = rows[: len(rows) // blocks * blocks].reshape(-1, blocks)
        packets = [
            hesai_packet(
                "PandarXT-16", angle[some], steps[some], intensity[some], stamp_us=1000 * k
            )
            for k, some in enumerate(rows)
        ]
        write_pcap(tmp_path / f"{name}.pcap", packets)
        frames = list(open_recording(tmp_path / f"{name}.pcap"))
        assert len(frames) == (2 if name == "back" else 3)
        assert {len(np.unique(one.column)) for one in frames[:2]} == {360 if name == "back" else 72}


def test_bytes_of_a_return_are_those_of_the_packet(tmp_path):
    """A checksum, safety, signature and more bytes of a return follow as the flags say."""
    points = []
    for flags in (0x00, 0x01, 0x05, 0x07, 0x0D, 0x15, 0x25, 0x3D):
        packets, *_ = hesai_turns("OT128", 128, 2, columns=40, turns=1.0, start=0.0, flags=flags)
        write_pcap(tmp_path / "a.pcap", packets)
        frame = open_recording(tmp_path / "a.pcap:OT128").read(0)
        points.append(np.column_stack([frame.points, frame.intensity, frame.ring]))
    for other in points[1:]:
        np.testing.assert_array_equal(other, points[0])


def test_which_angles_are_taken(tmp_path, shared_data):
    for model in ALIKE:
        packets, *_ = hesai_turns(model, *MODELS[model][:2], turns=1.2)
        path = tmp_path / f"{model}.pcap"
        write_pcap(path, packets)
        with pytest.raises(InputError, match=r"which are alike.*\.pcap:Pandar.*\.csv"):
            open_recording(path)
        told = open_recording(path.with_name(f"{path.name}:{model.lower()}"))
        assert any(f"catalogue's of the {model}" in note for note in told.notes)
    with pytest.raises(InputError, match=r"no unit Pandar64"):
        open_recording(path.with_name(f"{path.name}:Pandar64"))
    # An angle correction of another model, and one that is none.
    packets, *_ = hesai_turns("Pandar64", 64, 6, turns=1.2)
    (tmp_path / "own").mkdir()
    write_pcap(tmp_path / "own" / "a.pcap", packets)
    correction = tmp_path / "own" / "unit-0815.csv"
    correction.write_bytes((shared_data / "sensors" / MODELS["PandarXT-16"][2]).read_bytes())
    with pytest.raises(InputError, match=r"unit-0815\.csv.*16 channels.*64"):
        open_recording(tmp_path / "own")
    correction.rename(tmp_path / "own" / "b.csv")
    correction.write_bytes((shared_data / "sensors" / MODELS["Pandar64"][2]).read_bytes())
    with pytest.raises(InputError, match=r"2 angle corrections.*a\.csv"):
        open_recording(tmp_path / "own")
    (tmp_path / "own" / "b.csv").write_text("frame,time\n1,2\n")  # a table of something else
    assert any("unit-0815.csv" in note for note in open_recording(tmp_path / "own").notes)


def test_a_clock_that_jumps_is_said(tmp_path):
    packets, *_ = hesai_turns("PandarXT-16", 16, 8, turns=1.0, start=0.0)
    half = len(packets) // 2
    year = -4 - 1 - 4 - 6  # before sequence, factory information and microseconds
    moved = [one[:year] + bytes([130]) + one[year + 1 :] for one in packets[half:]]
    write_pcap(tmp_path / "a.pcap", packets[:half] + moved)
    frame = open_recording(tmp_path / "a.pcap").read(0)
    assert frame.time_s is None
    assert "clock jumps" in frame.notes[0]


def test_a_protocol_that_is_not_read(tmp_path):
    packets, *_ = hesai_turns("QT128", 128, 2, turns=0.2)
    write_pcap(tmp_path / "a.pcap", [one[:2] + bytes([4, 3]) + one[4:] for one in packets])
    with pytest.raises(InputError, match=r"a\.pcap: holds packets of Hesai's protocol 4\.3"):
        open_recording(tmp_path / "a.pcap")
