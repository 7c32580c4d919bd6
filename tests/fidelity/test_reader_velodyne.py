"""Captures of Velodyne's sensors: packets packed by the manuals from known ranges.

Points are those of the manuals' formula ("VLP-16 User Manual" 9.2 to 9.4 and its like): every laser
at its elevation, at the block's azimuth and what the sensor turned on until it fired.
"""

import struct

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar.catalogue import sensor

from .lidar_packets import (
    BANKS,
    DUAL,
    LAST,
    SOURCE,
    STRONGEST,
    VELODYNE,
    velodyne_packet,
    write_pcap,
    write_pcapng,
)

#: Seconds from block to block of one return, metres of a step, and firings in a block.
MODELS = {
    "VLP-16": (2 * 55.296e-6, 0.002, 2),
    "VLP-16 Hi-Res": (2 * 55.296e-6, 0.002, 2),
    "VLP-32C": (55.296e-6, 0.004, 1),
    "HDL-32E": (46.08e-6, 0.002, 1),
}
RATE_HZ = 10
#: Vertical corrections of the VLP-16's lasers, from the lowest up (user manual, table 9-1).
ABOVE_MM = (11.2, 9.7, 8.1, 6.6, 5.1, 3.7, 2.2, 0.7,
            -0.7, -2.2, -3.7, -5.1, -6.6, -8.1, -9.7, -11.2)  # fmt: skip


def turning(model, mode=STRONGEST, *, turns=2.3, start=350.0, seed=0, source=SOURCE, port=2368):
    """Return packets of a turning sensor, and azimuth (B,), steps and intensity (B, 32) of blocks.

    Of two returns, those of the blocks that come first: the last ones.
    """
    rng = np.random.default_rng(seed)
    period = MODELS[model][0]
    returns = 2 if mode == DUAL else 1
    per = 12 // returns
    count = int(turns / RATE_HZ / period / per)
    azimuth = (start + np.arange(count * per) * 360 * RATE_HZ * period) % 360
    steps = rng.integers(500, 20000, (count * per, 32))
    steps[rng.random(steps.shape) < 0.2] = 0
    intensity = rng.integers(0, 256, steps.shape)
    packets = []
    for number in range(count):
        some = np.repeat(np.arange(number * per, (number + 1) * per), returns)
        blocks = [list(zip(steps[k].tolist(), intensity[k].tolist(), strict=True)) for k in some]
        for other in blocks[1::2] if returns == 2 else ():
            other[:8] = [(max(a - 400, 0) and a - 400, min(b + 1, 255)) for a, b in other[:8]]
            other[8:16] = [(max(a - 400, 0) and a - 400, max(b - 1, 0)) for a, b in other[8:16]]
        time = number * per * period
        packet = velodyne_packet(
            azimuth[some], blocks, VELODYNE[model], mode=mode, stamp_us=int(time * 1e6)
        )
        packets.append((packet, 1.7e9 + time, source, port))
    return packets, azimuth, steps, intensity


def by_manual(model, azimuth, steps):
    """Return x forward, y left, z up, ring and time of blocks' points, one after the other."""
    period, step_m, firings = MODELS[model]
    block, laser = np.nonzero(steps)
    of_model = sensor(model)
    channel = laser % of_model.channels
    apart = {"VLP-32C": 2.304e-6, "HDL-32E": 1.152e-6}.get(model, 2.304e-6)
    within = (laser // 2 if model == "VLP-32C" else channel) * apart
    within = within + laser // of_model.channels * 55.296e-6 * (firings == 2)
    angle = azimuth[block] + within * 360 * RATE_HZ - of_model.azimuth_offset_deg[channel]
    angle, up = np.radians(angle), np.radians(of_model.elevation_deg[channel])
    range_m = steps[block, laser] * step_m
    flat = range_m * np.cos(up)
    points = np.column_stack([flat * np.cos(angle), -flat * np.sin(angle), range_m * np.sin(up)])
    return points, np.argsort(np.argsort(of_model.elevation_deg))[channel], block * period + within


def apart_deg(points, others):
    """Return how far the headings of points (N,) differ."""
    heading, other = (np.arctan2(one[:, 1], one[:, 0]) for one in (points, others))
    return np.abs((np.degrees(heading - other) + 180) % 360 - 180)


def whole_turn(azimuth, per):
    """Return the blocks of the first whole turn, which begins with a packet, as drivers cut."""
    begins = 1 + np.flatnonzero(np.diff(azimuth[::per]) < 0)
    return slice(begins[0] * per, begins[1] * per)


@pytest.mark.parametrize("mode", [STRONGEST, LAST])
@pytest.mark.parametrize("model", MODELS)
def test_points_of_every_model(tmp_path, model, mode):
    packets, azimuth, steps, intensity = turning(model, mode)
    write_pcap(tmp_path / "a.pcap", packets)
    recording = open_recording(tmp_path)
    assert (recording.layout, recording.names) == ("velodyne", ("1", "2"))
    assert len(recording.notes) == 2
    frame = recording.read(0)
    turn = whole_turn(azimuth, 12)
    points, ring, time = by_manual(model, azimuth[turn], steps[turn])
    assert apart_deg(frame.points, points).max() < 0.012  # the decoder turns in steps of 0.01
    flat, other = (np.hypot(one[:, 0], one[:, 1]) for one in (frame.points, points))
    assert np.abs(flat - other).max() < 2e-3
    # Lasers do not leave from one height: those of the VLP-16 from where its manual says.
    above = frame.points[:, 2] - points[:, 2]
    heights = np.array([above[ring == one].mean() for one in range(ring.max() + 1)])
    assert np.abs(above - heights[ring]).max() < 1e-3
    if model == "VLP-16":
        np.testing.assert_allclose(heights, np.array(ABOVE_MM) / 1000, atol=1e-4)
    assert np.abs(heights).max() < 0.03
    np.testing.assert_array_equal(frame.ring, ring)
    np.testing.assert_array_equal(frame.intensity, intensity[turn][np.nonzero(steps[turn])])
    np.testing.assert_allclose(frame.time_s, time, atol=3e-6)
    firings = MODELS[model][2] * len(azimuth[turn])
    assert frame.column.max() == firings - 1


def test_of_two_returns_the_stronger_is_read(tmp_path):
    packets, azimuth, steps, intensity = turning("VLP-16", DUAL)
    write_pcap(tmp_path / "a.pcap", packets)
    recording = open_recording(tmp_path / "a.pcap")
    assert any("the stronger" in note for note in recording.notes)
    frame = recording.read(0)
    turn = whole_turn(azimuth, 6)
    strongest, laser = steps[turn].copy(), np.arange(32)
    # The first eight lasers have a stronger return before the last one, the next a weaker one.
    nearer = (laser < 8) & (strongest > 400) & (intensity[turn] < 255)
    strongest[nearer] -= 400
    points, ring, _ = by_manual("VLP-16", azimuth[turn], strongest)
    np.testing.assert_array_equal(frame.ring, ring)
    near = np.linalg.norm(frame.points - points, axis=1) < 0.03
    assert near.mean() > 0.995  # but where 255 is the strongest there is


@pytest.mark.parametrize("mode", [STRONGEST, DUAL])
def test_a_vls_128(tmp_path, mode):
    """Its blocks are banks of 32 lasers; the library's own splitting finds the same turns."""
    rng, period = np.random.default_rng(3), 53.3e-6 * 5  # quicker than it turns
    per, banks = (3, BANKS) if mode == STRONGEST else (1, (*np.repeat(BANKS, 2), *[0] * 4))
    packets = []
    for number in range(int(1.4 / RATE_HZ / period / per)):
        columns = number * per + np.arange(12) // 4 * (per == 3)
        rows = np.stack([rng.integers(5000, 30000, (12, 32)), rng.integers(0, 256, (12, 32))], -1)
        blocks = rows.tolist()
        azimuth = (100 + columns * 360 * RATE_HZ * period) % 360
        time = number * per * period
        packet = velodyne_packet(
            azimuth, blocks, VELODYNE["VLS-128"], mode=mode, stamp_us=int(time * 1e6),
            banks=[int(one) for one in banks],
        )  # fmt: skip
        packets.append((packet, time, SOURCE, 2368))
    # Imported here: what is imported before the tests begin, they keep to the end, which it tells.
    import velodyne_decoder

    write_pcap(tmp_path / "a.pcap", packets)
    frame = open_recording(tmp_path / "a.pcap:VLS-128").read(0)
    settings = velodyne_decoder.Config(min_range=0, max_range=1000, cut_angle=0.0)
    scans = list(velodyne_decoder.read_pcap(tmp_path / "a.pcap", settings, as_pcl_structs=True))
    theirs = max(scans, key=lambda one: len(one.points)).points
    # A packet at the seam may be of either turn.
    told = {tuple(one) for one in np.column_stack([theirs[k] for k in "xyz"]).tolist()}
    ours = {tuple(one) for one in frame.points.tolist()}
    assert len(ours & told) / len(ours) > 0.99
    assert set(frame.ring) == set(range(128))
    elevation = np.degrees(np.arcsin(frame.points[:, 2] / np.linalg.norm(frame.points, axis=1)))
    of_ring = [elevation[frame.ring == ring].mean() for ring in range(128)]
    np.testing.assert_allclose(of_ring, np.sort(sensor("VLS-128").elevation_deg), atol=0.06)


def test_a_capture_by_wireshark_and_in_either_order(tmp_path):
    packets, *_ = turning("VLP-16", turns=1.5)
    write_pcap(tmp_path / "a.pcap", packets)
    first = open_recording(tmp_path / "a.pcap").read(0)
    write_pcapng(tmp_path / "b.pcapng", packets)
    write_pcapng(tmp_path / "c.pcapng", packets, order=">")
    write_pcap(tmp_path / "d.cap", packets, order=">", fractions=10**9)
    write_pcap(tmp_path / "without ending", packets)
    for name in ("b.pcapng", "c.pcapng", "d.cap", "without ending"):
        frame = open_recording(tmp_path / name).read(0)
        np.testing.assert_array_equal(frame.points, first.points)
        np.testing.assert_allclose(frame.time_s, first.time_s, atol=2e-6)


def test_of_several_units_one_is_chosen(tmp_path):
    first, *_ = turning("VLP-16", turns=1.5)
    second, *_ = turning("VLP-32C", turns=1.5, source=(10, 0, 0, 7), port=2369, seed=5)
    third, *_ = turning("HDL-32E", turns=1.5, seed=6)  # in the place of the first
    path = tmp_path / "a.pcap"
    both = sorted(first + second, key=lambda one: one[1])
    write_pcap(path, [bytes(48), *both])
    with pytest.raises(InputError) as raised:
        open_recording(path)
    line = str(raised.value)
    assert "2 units" in line
    assert "192.168.1.201:2368 (VLP-16," in line
    assert "10.0.0.7:2369 (VLP-32C," in line
    assert "as a.pcap:192.168.1.201:2368" in line
    for choice in ("2369", "10.0.0.7", "10.0.0.7:2369", "vlp-32c", "10.0.0.7:2369:VLP-32C"):
        frame = open_recording(path.with_name(f"a.pcap:{choice}")).read(0)
        assert set(frame.ring) == set(range(32))
    assert open_recording(tmp_path.with_name(f"{tmp_path.name}:2368")).read(0).ring.max() == 15
    with pytest.raises(InputError, match=r"has no unit 1\.2\.3\.4; expected one of 10"):
        open_recording(path.with_name("a.pcap:1.2.3.4"))
    # Two models from one address to one port: a unit was replaced, or captures were joined.
    write_pcap(path, first + third)
    with pytest.raises(InputError, match=r"2 units.*a\.pcap:192\.168\.1\.201:2368:MODEL"):
        open_recording(path)
    assert set(open_recording(path.with_name("a.pcap:HDL-32E")).read(0).ring) == set(range(32))


def test_a_capture_that_was_cut(tmp_path):
    packets, *_ = turning("VLP-16", turns=2.2)
    path = tmp_path / "a.pcap"
    write_pcap(path, packets)
    whole = open_recording(path)
    path.write_bytes(path.read_bytes()[:-500])
    cut = open_recording(path)
    assert cut.names == whole.names
    np.testing.assert_array_equal(cut.read(0).points, whole.read(0).points)
    packets[3] = (packets[3][0][:900], *packets[3][1:])  # cut while it was captured
    write_pcap(path, packets)
    assert len(open_recording(path).read(0).points) > 10_000


def test_bad_captures(tmp_path):
    path = tmp_path / "a.pcap"
    packets, *_ = turning("VLP-16", turns=0.2)
    write_pcap(path, [(one[0][:-1] + b"\x23", *one[1:]) for one in packets])
    with pytest.raises(InputError, match=r"a\.pcap: is of a VLP-32A or B, which its packets"):
        open_recording(path)
    # A model that nobody knows, and an azimuth beyond 360 degrees, which is left out.
    write_pcap(path, [(one[0][:-1] + b"\x77", *one[1:]) for one in packets])
    with pytest.raises(InputError, match=r"a\.pcap: holds packets of a Velodyne of model 0x77"):
        open_recording(path)
    write_pcap(path, [bytes(700)] * 5)
    with pytest.raises(InputError, match="no packets of a Velodyne or Hesai, and no JSON beside"):
        open_recording(path)
    wrong = packets[0][0][:2] + struct.pack("<H", 40000) + packets[0][0][4:]
    write_pcap(path, [wrong, *packets])
    assert len(open_recording(path)) == 1
    with pytest.raises(InputError, match="is not laid out as a capture of a Hesai"):
        open_recording(path, "hesai")


def status_of_hdl_64e(corrections):
    """Return the bytes that an HDL-64E S2 sends along: its calibration (manual, appendix E)."""
    status = b"UNIT#" + bytes([24, 24])
    for number, (up, turn) in enumerate(corrections):
        values = (round(up * 100), round(turn * 100), 0, 0, 0, 0, 0, 0, 0)
        status += struct.pack("<B9hBB", number, *values, 0, 255)
        status += bytes([16, 1, 2, 3, 4, 5, 40]) if number == 63 else bytes(7)  # when, how humid
    status += bytes(19) + struct.pack("<H", 1820)
    assert len(status) == 1820
    return status


def test_an_hdl_64e_and_its_calibration(tmp_path):
    rng = np.random.default_rng(4)
    corrections = np.column_stack([np.linspace(2, -24, 64), rng.uniform(-5, 5, 64)])
    status = status_of_hdl_64e(corrections.round(2).tolist())
    steps = rng.integers(1000, 20000, 32)
    packets = []
    for number in range(2100):
        # What a packet's last bytes are: date and the like by turns, then the calibration.
        told = (0x31, status[(number - 9) % 1820])
        kind, value = (b"HMSDNYGTV"[number], 1) if number < 9 else told
        azimuth = (number * 1.2 + np.arange(12) // 2 * 0.2) % 360
        packet = velodyne_packet(
            azimuth, [[(int(one), 50) for one in steps]] * 12, bytes([kind, value]), banks=BANKS[:2]
        )
        packets.append((packet, number * 288e-6, SOURCE, 2368))
    write_pcap(tmp_path / "a.pcap", packets)
    recording = open_recording(tmp_path / "a.pcap")
    assert not any("calibration" in note for note in recording.notes)
    frame = recording.read(1)
    elevation = np.degrees(np.arcsin(frame.points[:, 2] / np.linalg.norm(frame.points, axis=1)))
    of_ring = [elevation[frame.ring == ring].mean() for ring in range(64)]
    np.testing.assert_allclose(of_ring, np.sort(corrections[:, 0].round(2)), atol=0.01)
    # Too short a capture for all of it.
    write_pcap(tmp_path / "a.pcap", packets[:700])
    assert "not whole in its packets" in open_recording(tmp_path / "a.pcap").notes[0]
