"""Captures of Ouster sensors: the real one, and its packets in other profiles and fragments.

The real scan's points are checked against the beams of its metadata by the formula of the
sensor's documentation. ("Lidar Range to XYZ"). Other captures are the real pixels packed here anew
by the documented formats and by RFC 791.
"""

import json
import shutil
import struct

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording

from .lidar_packets import write_pcap
from .test_reader_velodyne import turning

NAME = "OS-1-128_v2.3.0_1024x10"
ROWS, COLUMNS, PER_PACKET = 128, 1024, 16


@pytest.fixture(scope="module")
def capture(shared_data):
    folder = shared_data / "lidar/ouster-os1-128"
    return folder / f"{NAME}_lb_n3.pcap", json.loads((folder / f"{NAME}.json").read_text())


@pytest.fixture(scope="module")
def scan(capture):
    """Return the first real frame as it is read."""
    return open_recording(capture[0]).read(0)


def test_a_real_capture(capture, scan):
    path, metadata = capture
    recording = open_recording(path.parent)
    assert (recording.layout, recording.names) == ("ouster", ("1795", "1796", "1797"))
    assert len(scan.points) == 107_647  # of 131,072, as the data's description says
    assert recording.notes == ()
    # Undo the projection: every point is on the beam of its row and column.
    to_sensor = np.array(metadata["lidar_to_sensor_transform"]).reshape(4, 4)
    lidar = (scan.points - to_sensor[:3, 3] / 1000) @ to_sensor[:3, :3]
    theta = 2 * np.pi * (1 - scan.column / COLUMNS)
    n = metadata["lidar_origin_to_beam_origin_mm"] / 1000
    beam = lidar - n * np.column_stack([np.cos(theta), np.sin(theta), np.zeros(len(theta))])
    up = np.degrees(np.arctan2(beam[:, 2], np.hypot(beam[:, 0], beam[:, 1])))
    turn = np.degrees(theta - np.arctan2(beam[:, 1], beam[:, 0]))
    off = turn - np.array(metadata["beam_azimuth_angles"])[scan.ring]
    assert up == pytest.approx(np.array(metadata["beam_altitude_angles"])[scan.ring], abs=1e-9)
    assert np.abs((off + 180) % 360 - 180).max() < 1e-9
    # Steps of 8 mm.
    steps = (np.linalg.norm(beam, axis=1) + n) / 0.008
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert 0.099 < scan.time_s.max() < 0.101


def packets_of(scan, kind, frame):
    """Pack a scan by the documented format: LEGACY or RNG19_RFL8_SIG16_NIR16_DUAL."""
    legacy = kind == "LEGACY"
    size = 12 if legacy else 16
    image = np.zeros((COLUMNS, ROWS, size), np.uint8)
    millimetres = range_of(scan)
    row, column = scan.ring, scan.column
    image[column, row, :4] = millimetres.astype("<u4")[:, None].view(np.uint8)
    image[column, row, 4 if legacy else 3] = scan.intensity
    if not legacy:  # a second return beyond, and flags in the upper bits of the first's range
        image[column, row, 2] |= 0b11111000
        image[column, row, 4:8] = (millimetres + 999).astype("<u4")[:, None].view(np.uint8)
    time = np.arange(COLUMNS) * 97_000 + 10**18
    for first in range(0, COLUMNS, PER_PACKET):
        body = b""
        for k in range(first, first + PER_PACKET):
            pixels = image[k].tobytes()
            if legacy:
                body += struct.pack("<QHHI", time[k], k, frame, 0) + pixels
                body += struct.pack("<I", 0xFFFFFFFF)
            else:
                body += struct.pack("<QHH", time[k], k, 1) + pixels
        if not legacy:
            body = struct.pack("<HH28x", 1, frame) + body + bytes(32)
        yield body


def range_of(scan):
    """Return the ranges in millimetres: of the real scan, which has steps of 8."""
    to_sensor = np.array([0, 0, 0.03618])
    theta = 2 * np.pi * (1 - scan.column / COLUMNS)
    beam = (scan.points - to_sensor) * [-1, -1, 1]
    n = 0.015806
    beam = beam - n * np.column_stack([np.cos(theta), np.sin(theta), np.zeros(len(theta))])
    return np.round((np.linalg.norm(beam, axis=1) + n) * 1000)


def ip_packets(payload, identity, mtu):
    """Return the IPv4 packets of one UDP datagram, by RFC 791 and RFC 768."""
    datagram = struct.pack(">HHHH", 7502, 7502, len(payload) + 8, 0) + payload
    step = (mtu - 20) // 8 * 8
    parts = []
    for at in range(0, len(datagram), step):
        part = datagram[at : at + step]
        more = 0x2000 if at + step < len(datagram) else 0
        header = struct.pack(
            ">BBHHHBBH4s4s",
            0x45, 0, 20 + len(part), identity, more | at // 8, 64, 17, 0,
            bytes([10, 0, 0, 1]), bytes([10, 0, 0, 2]),
        )  # fmt: skip
        parts.append(header + part)
    return parts


def write_capture(path, payloads, *, mtu=1500, order="<", link=1, shuffled=None, vlan=b""):
    frames = []
    for identity, payload in enumerate(payloads):
        parts = ip_packets(payload, identity & 0xFFFF, mtu)
        if shuffled:
            shuffled.shuffle(parts)
        frames += parts
    ether = bytes(12) + vlan + b"\x08\x00"
    head = {1: ether, 101: b""}[link]
    with path.open("wb") as stream:
        stream.write(struct.pack(order + "IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, link))
        for frame in frames:
            stream.write(struct.pack(order + "IIII", 0, 0, *[len(head + frame)] * 2) + head + frame)


def write_metadata(path, metadata, kind):
    changed = json.loads(json.dumps(metadata))
    changed["data_format"]["udp_profile_lidar"] = kind
    path.write_text(json.dumps(changed))


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("LEGACY", {"mtu": 1500, "vlan": b"\x81\x00\x00\x05"}),
        ("LEGACY", {"mtu": 1500, "vlan": b"\x88\xa8\x00\x64\x81\x00\x00\x05"}),
        ("LEGACY", {"mtu": 1500, "vlan": b"\x91\x00\x00\x64\x88\xa8\x00\x02\x81\x00\x00\x05"}),
        ("RNG19_RFL8_SIG16_NIR16_DUAL", {"mtu": 9000, "order": ">", "link": 101}),
    ],
)
def test_other_profiles_in_fragments(tmp_path, capture, scan, kind, options):
    payloads = [bytes(48)]  # of the inertial sensor
    payloads += list(packets_of(scan, kind, 65535))
    payloads += list(packets_of(scan, kind, 0))[:20]  # cut: the next turn, numbered anew
    write_capture(tmp_path / "a.pcap", payloads, shuffled=np.random.default_rng(1), **options)
    write_metadata(tmp_path / "a.json", capture[1], kind)
    recording = open_recording(tmp_path / "a.pcap")
    assert recording.names == ("65535",)
    assert any("part of" in note for note in recording.notes)
    assert any("two returns" in note for note in recording.notes) == (kind != "LEGACY")
    frame = recording.read(0)
    np.testing.assert_allclose(frame.points, scan.points, atol=1e-9)
    np.testing.assert_array_equal(frame.intensity, scan.intensity)
    assert frame.time_s.max() == pytest.approx(1023 * 97e-6)


def test_lost_packets_are_said(tmp_path, capture, scan):
    kind = "LEGACY"
    payloads = list(packets_of(scan, kind, 7))
    del payloads[3]
    write_capture(tmp_path / "a.pcap", payloads, mtu=65000)
    write_metadata(tmp_path / "a.json", capture[1], kind)
    frame = open_recording(tmp_path).read(0)
    assert frame.notes == ("16 of 1024 columns are missing.",)
    assert not set(range(48, 64)) & set(frame.column)
    # Cut within a packet: what was before is read.
    path = tmp_path / "a.pcap"
    path.write_bytes(path.read_bytes()[:-100])
    assert open_recording(path).read(0).notes == ("32 of 1024 columns are missing.",)


def test_bad_captures(tmp_path, capture):
    path, _ = capture
    mine = tmp_path / "a.pcap"
    shutil.copy(path, mine)
    with pytest.raises(InputError, match=r"no JSON beside it.*a\.json"):
        open_recording(mine)
    metadata = json.loads((path.parent / f"{NAME}.json").read_text())
    write_metadata(tmp_path / "a.json", metadata, "LEGACY")
    with pytest.raises(InputError, match=r"no packet of 24896 bytes"):
        open_recording(mine)
    write_metadata(tmp_path / "a.json", metadata, "RNG99")
    with pytest.raises(InputError, match=r"a\.json: udp_profile_lidar: RNG99 is unknown"):
        open_recording(mine)
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(InputError, match=r"a\.json.*beam_altitude_angles"):
        open_recording(mine)
    write_metadata(tmp_path / "a.json", metadata, "RNG15_RFL8_NIR8")
    mine.write_bytes(b"\x0a\x0d\x0d\x0a" + bytes(100))
    with pytest.raises(InputError, match="pcapng"):
        open_recording(mine)
    for data in (b"", b"\xd4\xc3", b"text that is none" * 3):
        mine.write_bytes(data)
        with pytest.raises(InputError, match=r"a\.pcap"):
            open_recording(mine)


def test_of_several_units_one_is_chosen(tmp_path, capture, scan):
    """Two Ousters and a Velodyne in one capture, each told by its packets."""
    kind = "LEGACY"
    velodyne, *_ = turning("VLP-16", turns=1.5)
    packets = list(packets_of(scan, kind, 7))
    path = tmp_path / "a.pcap"
    units = {"10.0.0.1": packets, "10.0.0.2": packets[:64]}
    rows = [
        (one, 1.7e9 + k * 1e-3, tuple(map(int, source.split("."))), 7502)
        for source, some in units.items()
        for k, one in enumerate(some)
    ]
    write_pcap(path, sorted(rows + velodyne, key=lambda one: one[1]))
    # Without the Ousters' metadata, the Velodyne's packets are all that is known.
    assert open_recording(path).layout == "velodyne"
    write_metadata(tmp_path / "a.json", capture[1], kind)
    with pytest.raises(InputError) as raised:
        open_recording(tmp_path)
    for told in ("3 units", "10.0.0.1:7502 (Ouster, 64", "10.0.0.2:7502", "2368 (VLP-16"):
        assert told in str(raised.value)
    for choice in ("10.0.0.1", "10.0.0.2:7502"):
        recording = open_recording(path.with_name(f"a.pcap:{choice}"))
        assert (recording.layout, recording.names) == ("ouster", ("7",))
        np.testing.assert_allclose(recording.read(0).points, scan.points, atol=1e-9)
    assert open_recording(path.with_name("a.pcap:2368")).layout == "velodyne"
    assert open_recording(path, "velodyne").layout == "velodyne"
