"""The catalogue's OS1-128 against the packets of the real sensor that its table is of.

The packets are decoded here, by the format that the sensor's documentation gives, and by nothing
of the project: profile ``RNG15_RFL8_NIR8`` (low data rate), 16 columns a packet, no column header
but time, measurement id and status; a pixel is 4 bytes, range in its low 15 bits, in 8 mm.
"""

import json
import struct

import numpy as np
import pytest

from urbantwin.lidar import beam_directions, sensor

ROWS, COLUMNS = 128, 1024
_PACKET_HEADER, _COLUMN_HEADER, _PIXEL, _PACKET_FOOTER = 32, 12, 4, 32
_PER_PACKET = 16


@pytest.fixture(scope="module")
def recording(shared_data):
    """Return the scans' ranges (S, 128, 1024) in metres, and the unit's metadata."""
    folder = shared_data / "lidar/ouster-os1-128"
    metadata = json.loads((folder / "OS-1-128_v2.3.0_1024x10.json").read_text())
    assert metadata["data_format"]["udp_profile_lidar"] == "RNG15_RFL8_NIR8"
    raw = (folder / "OS-1-128_v2.3.0_1024x10_lb_n3.pcap").read_bytes()
    scans: dict[int, np.ndarray] = {}
    at = 24  # the header of a pcap file; each packet then has one of 16 bytes
    while at < len(raw):
        size = struct.unpack_from("<I", raw, at + 8)[0]
        packet = raw[at + 16 : at + 16 + size]
        at += 16 + size
        payload = packet[14 + 20 + 8 :]  # Ethernet, IPv4, UDP
        column_bytes = _COLUMN_HEADER + ROWS * _PIXEL
        if len(payload) != _PACKET_HEADER + _PER_PACKET * column_bytes + _PACKET_FOOTER:
            continue  # of the inertial sensor
        frame = struct.unpack_from("<H", payload, 2)[0]
        scan = scans.setdefault(frame, np.zeros((ROWS, COLUMNS)))
        for number in range(_PER_PACKET):
            start = _PACKET_HEADER + number * column_bytes
            column, status = struct.unpack_from("<8xHH", payload, start)
            if status & 1:
                pixel = np.frombuffer(payload, "<u4", ROWS, start + _COLUMN_HEADER)
                scan[:, column] = (pixel & 0x7FFF) * 0.008
    return np.array([scans[frame] for frame in sorted(scans)]), metadata


def test_the_packets_are_decoded(recording):
    """107,647 of the first scan's 131,072 pixels are valid, says the data's description."""
    ranges, _ = recording
    assert ranges.shape == (3, ROWS, COLUMNS)
    assert (ranges[0] > 0).sum() == 107_647


def test_every_beam_of_the_real_scan_points_where_the_catalogue_says(recording):
    """Project the scan as the documentation does ("Lidar Range to XYZ"), then look back.

    A beam leaves at the distance n from the axis, under the encoder's angle theta; its point is
    at the range r of the path from the axis over n, and turned by the beam's own azimuth phi.
    """
    ranges, metadata = recording
    n = metadata["lidar_origin_to_beam_origin_mm"] / 1000
    theta = 2 * np.pi * (1 - np.arange(COLUMNS) / COLUMNS)[None, :]
    phi = -np.radians(metadata["beam_azimuth_angles"])[:, None]
    up = np.radians(metadata["beam_altitude_angles"])[:, None]
    to_sensor = np.array(metadata["lidar_to_sensor_transform"]).reshape(4, 4)
    ours = beam_directions(sensor("OS1-128"), COLUMNS)
    for r in ranges:
        lidar = np.stack(
            [
                (r - n) * np.cos(theta + phi) * np.cos(up) + n * np.cos(theta),
                (r - n) * np.sin(theta + phi) * np.cos(up) + n * np.sin(theta),
                (r - n) * np.sin(up),
            ],
            axis=-1,
        )
        seen = r > 1.0
        assert seen.sum() > 90_000
        axis = np.broadcast_to(theta, r.shape)[seen]
        start = np.stack([n * np.cos(axis), n * np.sin(axis), np.zeros(axis.shape)], axis=-1)
        beam = (lidar[seen] - start) @ to_sensor[:3, :3].T
        beam /= np.linalg.norm(beam, axis=1, keepdims=True)
        # The scan begins at the connector, behind; our first column looks forward.
        mine = np.roll(ours, COLUMNS // 2, axis=1)[seen]
        angle = 2 * np.arcsin(np.linalg.norm(beam - mine, axis=1) / 2)
        assert np.degrees(angle).max() < 0.01


def test_the_catalogue_knows_where_its_beams_leave(recording):
    _, metadata = recording
    millimetres = metadata["lidar_origin_to_beam_origin_mm"]
    assert sensor("OS1-128").beam_origin_m == pytest.approx(millimetres / 1000, abs=1e-6)


@pytest.mark.thorough
def test_the_world_lines_up_at_the_offsets_of_the_catalogue(recording):
    """What neighbouring rows see does not depend on any angle that the metadata gives.

    Two rows look at nearly the same places, but the second earlier or later in the turn: the
    shift of columns at which their ranges agree best is the difference of their offsets.
    """
    ranges, _ = recording
    lidar = sensor("OS1-128")
    shifts = np.arange(-40, 41)
    errors = []
    for row in range(ROWS - 1):
        score = np.zeros(len(shifts))
        for r in ranges:
            for number, shift in enumerate(shifts):
                other = np.roll(r[row + 1], shift)
                both = (r[row] > 0) & (other > 0)
                apart = np.abs(np.log(r[row][both] / other[both])) if both.any() else [1.0]
                score[number] += np.minimum(apart, 0.2).mean()
        measured = shifts[score.argmin()] * 360 / COLUMNS
        expected = lidar.azimuth_offset_deg[row] - lidar.azimuth_offset_deg[row + 1]
        errors.append(measured - expected)
    errors = np.abs(errors)
    assert np.median(errors) < 0.2  # half a column is 0.18 deg
    assert (errors < 0.6).mean() > 0.8
