"""Messages: the content that comes back, how far off, from how many bits; what a channel loses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from numpy.typing import NDArray
from scipy.spatial import cKDTree

pytest.importorskip("torch", reason="torch is not installed: pip install 'urbantwin[detector]'")

from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.studies.fusion.boxes import Boxes, moved_boxes
from urbantwin.studies.fusion.channel import Channel, received
from urbantwin.studies.fusion.messages import (
    HEADER_BYTES,
    FeatureMap,
    Points,
    Sent,
    quantised_boxes,
    quantised_cloud,
    quantised_features,
    sent,
)
from urbantwin.studies.fusion.nodes import Node

POSE = Pose.from_ypr([12.3456, -200.001, 4.5], 0.3, -0.02, 0.01)


def packed(quantised: tuple[Any, Any, int], mtu: int = 1400) -> Sent[Any]:
    return sent(quantised, mtu, POSE, 17.25)


def street(seed: int = 0, count: int = 6000) -> NDArray[np.float64]:
    """Ground, a wall and something small: points as a sensor sees them."""
    draw = np.random.default_rng(seed)
    ground = np.column_stack(
        [draw.normal(0, 18, (count, 2)).clip(-60, 60), draw.normal(0, 0.02, count)]
    )
    wall = np.column_stack([draw.uniform(-50, 50, count // 4), np.full(count // 4, 15.2),
                            draw.uniform(0, 4, count // 4)])  # fmt: skip
    small = draw.normal((5, 3, 0.9), 0.4, (count // 10, 3))
    return np.concatenate([ground, wall, small])


def unpacked(data: bytes) -> bytes:
    """Zstandard's own reader, of a frame without magic number."""
    return zstandard.ZstdDecompressor(format=zstandard.FORMAT_ZSTD1_MAGICLESS).decompress(
        data, max_output_size=1 << 24
    )


def columns(rows: NDArray[Any]) -> bytes:
    """The bytes of rows, those of each column by their significance, and numbers as steps."""
    rows = rows.copy()
    rows["key"] = np.diff(rows["key"], prepend=rows["key"].dtype.type(0))
    return np.ascontiguousarray(rows.view(np.uint8).reshape(len(rows), -1).T).tobytes()


def test_the_pose_is_told_to_a_millimetre_and_a_microradian() -> None:
    message = packed(quantised_cloud(Points(street()), 0.2))
    off = message.site_SE3_content
    assert np.abs(off.translation - POSE.translation).max() <= 5.1e-4
    assert np.abs(off.rotation - POSE.rotation).max() <= 3e-6
    assert message.stamp_s == 17.25


@pytest.mark.parametrize("with_intensity", [False, True])
@pytest.mark.parametrize("edge", [0.07, 0.25, 0.8])
def test_points_come_back_within_half_a_cells_diagonal(edge: float, with_intensity: bool) -> None:
    place = street()
    intensity = (place[:, 0] + 60) / 120 if with_intensity else None
    back, rows, _ = quantised_cloud(Points(place, intensity), edge)
    largest = np.sqrt(3) / 2 * edge
    away, nearest = cKDTree(back.place).query(place)
    assert away.max() <= largest + 1e-9
    assert cKDTree(place).query(back.place)[0].max() <= largest + 1e-9
    assert len(back.place) == len(rows) == len(np.unique(np.floor(place / edge), axis=0))
    if back.intensity is not None:
        # It grows by 1/120 a metre: no farther off than the points are, and its rounding.
        assert np.abs(back.intensity[nearest] - intensity).max() <= edge / 60 + 1 / 255


def test_a_cell_is_told_by_its_number_alone() -> None:
    # The lowest cell and how many blocks there are say which cell a number stands for.
    place, edge = street(), 0.2
    back, rows, _ = quantised_cloud(Points(place), edge)
    cell = np.floor(place / edge).astype(np.int64)
    low, high = cell.min(axis=0), cell.max(axis=0)
    across = (high - low) // 16 + 1
    block, within = np.divmod(rows["key"].astype(np.int64), 16**3)
    found = np.empty((len(rows), 3), np.int64)
    for axis in range(3):
        block, corner = np.divmod(block, across[axis])
        within, inner = np.divmod(within, 16)
        found[:, axis] = low[axis] + 16 * corner + inner
    assert np.allclose((found + 0.5) * edge, back.place)


@pytest.mark.parametrize("mtu", [300, 1400, 65_000])
def test_packets_are_zstandards_and_no_larger_than_they_may_be(mtu: int) -> None:
    _, rows, about = content = quantised_cloud(Points(street()), 0.2)
    message = packed(content, mtu)
    assert message.sizes.max() <= mtu
    assert message.bits == 8 * message.sizes.sum()
    assert len(message.sizes) == message.packet.max() + 1
    assert (np.diff(message.packet) >= 0).all()
    compressor = zstandard.ZstdCompressor(
        compression_params=zstandard.ZstdCompressionParameters.from_level(
            19, write_content_size=False, format=zstandard.FORMAT_ZSTD1_MAGICLESS
        )
    )
    for number, size in enumerate(message.sizes):
        plain = columns(rows[message.packet == number])
        data = compressor.compress(plain)
        assert size == HEADER_BYTES + about + len(data)
        assert unpacked(data) == plain
    assert len(message.sizes) == 1 or message.sizes[:-1].mean() > 0.8 * mtu


def test_a_row_that_fits_into_no_packet_is_told() -> None:
    draw = np.random.default_rng(3)
    values = draw.random((3, 512)).astype(np.float32)
    features = FeatureMap(0.0, 0.0, 0.4, 200, np.arange(3), values)
    with pytest.raises(InputError, match="--mtu: one row takes"):
        packed(quantised_features(features, 8, 512), 256)


def looking(number: int) -> Node:
    return Node(f"n{number}", number, Path(), {})


def test_as_many_packets_are_lost_as_are_to_be_with_their_points() -> None:
    message = packed(quantised_cloud(Points(street()), 0.1), 300)
    count = len(message.sizes)
    assert count > 50
    shares, before = [], np.zeros(count, bool)
    for share in (0.0, 0.01, 0.2, 0.5, 1.0):
        lost = []
        for moment in range(40):
            came = received(message, looking(1), moment, Channel(loss=share), seed=2)
            there = np.zeros(count, bool)
            if came is not None:
                there[came.packet] = True
                kept = message.content.place[there[message.packet]]
                assert (came.content.place == kept).all()
            lost.append(~there)
        assert not (before & ~np.array(lost)).any()  # lost at some share, at every greater one
        before = np.array(lost)
        shares.append(before.mean())
    sigma = 0.5 / np.sqrt(40 * count)
    assert shares == pytest.approx([0.0, 0.01, 0.2, 0.5, 1.0], abs=4 * sigma)


def test_poses_and_stamps_are_off_as_asked() -> None:
    message = packed(quantised_boxes(boxes()))
    channel = Channel(place_error_m=0.5, yaw_error_deg=2.0, clock_error_s=0.1)
    shifts, turns = [], []
    for moment in range(300):
        came = received(message, looking(1), moment, channel, seed=1)
        assert came is not None
        assert came.stamp_s == pytest.approx(17.35)
        pose = came.site_SE3_content
        shifts.append(pose.translation - POSE.translation)
        turn = pose.rotation @ message.site_SE3_content.rotation.T
        turns.append(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
    off = np.array(shifts)
    assert np.allclose(off.std(axis=0), [0.5, 0.5, 0], atol=0.09)
    assert np.abs(off.mean(axis=0)).max() < 0.13
    assert np.std(turns) == pytest.approx(2.0, rel=0.17)


def features(cells: int = 3000, channels: int = 16) -> FeatureMap:
    draw = np.random.default_rng(1)
    scale = draw.uniform(0.1, 6, channels)
    values = np.maximum(draw.normal(-0.4, 1, (cells, channels)) * scale, 0).astype(np.float32)
    values[:, 3] = 0
    cell = np.sort(draw.choice(200**2, cells, replace=False))
    return FeatureMap(-40.0, -40.0, 0.4, 200, cell, values)


def entropy(symbols: NDArray[np.uint8]) -> float:
    """Shannon's bits of independent symbols."""
    share = np.unique(symbols, return_counts=True)[1] / symbols.size
    return float(-(share * np.log2(share)).sum() * symbols.size)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_values_come_back_within_half_a_step(bits: int) -> None:
    told = features()
    back, rows, _ = quantised_features(told, bits, 16)
    # A step is the greatest value, rounded up to a sixteenth of an octave, over the levels.
    step = told.values.max(axis=0) * 2 ** (1 / 16) / (2**bits - 1)
    assert (np.abs(back.values - told.values).max(axis=0) <= step / 2 + 1e-6).all()
    assert (back.values[:, 3] == 0).all()
    assert rows["level"].max() == 2**bits - 1
    assert (back.cell == told.cell).all()


@pytest.mark.parametrize("bits", [2, 4, 8])
def test_features_take_about_as_many_bits_as_they_hold(bits: int) -> None:
    told = features()
    _, rows, _ = content = quantised_features(told, bits, 16)
    # Which cells: log2 of how many sets of 3,000 of 40,000 there are. What they say: each channel.
    count, held = 200**2, len(told.cell)
    sets = (
        np.log2(np.arange(count - held + 1, count + 1)).sum()
        - np.log2(np.arange(1, held + 1)).sum()
    )
    shannon = sets + sum(entropy(one) for one in rows["level"].T)
    assert shannon <= packed(content, 65_000).bits <= 1.1 * shannon


def test_channels_with_most_energy_are_sent() -> None:
    told = features()
    back, _, _ = content = quantised_features(told, 8, 4)
    assert packed(content).sizes.max() <= 1400
    assert packed(content).bits < packed(quantised_features(told, 8, 16)).bits
    most = np.argsort(-(told.values.astype(float) ** 2).sum(axis=0))[:4]
    assert set(np.flatnonzero(back.values.any(axis=0))) == set(most)


def test_nothing_seen_is_a_message_too() -> None:
    none = FeatureMap(0.0, 0.0, 0.4, 8, np.zeros(0, np.int64), np.zeros((0, 4), np.float32))
    for content in (
        quantised_features(none, 4, 4),
        quantised_boxes(boxes(0)),
        quantised_cloud(Points(np.zeros((0, 3)), np.zeros(0)), 0.1),
    ):
        message = packed(content)
        assert len(message.packet) == 0
        assert len(message.sizes) == 1
        assert HEADER_BYTES < message.sizes[0] <= HEADER_BYTES + 45
        assert received(message, looking(1), 0, Channel(), seed=0) is not None
    for count in (1, 2):
        cloud, _, _ = quantised_cloud(Points(np.full((count, 3), 3.3)), 0.1)
        assert np.abs(cloud.place - 3.3).max() <= 0.0501


def boxes(count: int = 60) -> Boxes:
    draw = np.random.default_rng(2)
    kind = draw.integers(0, 6, count)
    place = draw.uniform((-90, -90, -2), (90, 90, 2), (count, 3))
    yaw = draw.uniform(-np.pi, np.pi, count)
    box = np.column_stack([place, draw.uniform(0.4, 14, (count, 3)), yaw])
    root = draw.normal(0, 0.4, (count, 2, 2))
    covariance = np.zeros((count, 6, 6))
    covariance[:, :2, :2] = root @ root.transpose(0, 2, 1) + 0.05 * np.eye(2)
    covariance[:, range(2, 6), range(2, 6)] = draw.uniform(0.02, 3, (count, 4))
    return Boxes(box, kind, draw.random(count), draw.normal(0, 5, (count, 2)) / [1, 10], covariance)


def test_boxes_come_back_to_a_centimetre() -> None:
    told = boxes()
    back, rows, _ = content = quantised_boxes(told)
    assert rows.dtype.itemsize == 34
    assert packed(content, 500).sizes.max() <= 500
    assert np.abs(back.box[:, :6] - told.box[:, :6]).max() <= 0.0051
    off = np.angle(np.exp(1j * (back.box[:, 6] - told.box[:, 6])))
    assert np.abs(off).max() <= 2 * np.pi / 65536
    assert (back.kind == told.kind).all()
    assert np.abs(back.score - told.score).max() <= 0.5 / 255 + 1e-9
    assert np.abs(back.rates - told.rates).max() <= 0.0051
    # float16 keeps eleven bits; of x and y the two lines of the matrix, of the others the diagonal.
    assert np.allclose(back.covariance, told.covariance, rtol=2**-11, atol=1e-6)


def test_boxes_without_motion_and_covariance_are_cheaper_and_at_rest() -> None:
    back, rows, _ = content = quantised_boxes(boxes(), motion=False, covariance=False)
    assert rows.dtype.itemsize == 16
    assert packed(content).bits < packed(quantised_boxes(boxes())).bits
    assert (back.rates == 0).all()
    assert (np.linalg.eigvalsh(back.covariance) > 0).all()


def test_what_is_known_of_boxes_turns_with_them() -> None:
    told = boxes()
    turn = Pose.from_ypr([5, -2, 1], 0.7)
    there = moved_boxes(told, turn)
    assert np.allclose(there.velocity, told.velocity @ turn.rotation[:2, :2].T, atol=1e-9)
    plan = turn.rotation[:2, :2]
    assert np.allclose(there.covariance[:, :2, :2], plan @ told.covariance[:, :2, :2] @ plan.T)
    again = moved_boxes(there, turn.inverse())
    assert np.allclose(again.box[:, :6], told.box[:, :6])
    assert np.allclose(again.covariance, told.covariance)
