"""Messages and codecs: what comes back, how far off, from how many bits; what is damaged."""

import struct
import zlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

pytest.importorskip("torch", reason="torch is not installed: pip install 'urbantwin[detector]'")

from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.studies.fusion.box_codec import (
    Boxes,
    box_packets,
    boxes_of_payload,
    joined_boxes,
    moved_boxes,
)
from urbantwin.studies.fusion.feature_codec import (
    FeatureMap,
    feature_packets,
    features_of_payload,
    quantised,
    restored,
)
from urbantwin.studies.fusion.message import (
    CODECS,
    HEADER_BYTES,
    Head,
    Message,
    bits_of,
    pack,
    unpack,
)
from urbantwin.studies.fusion.packets import lost_packets
from urbantwin.studies.fusion.point_codecs import (
    PointCodec,
    Points,
    cloud_of_payload,
    cloud_packets,
)

POSE = Pose.from_ypr([12.3456, -200.001, 4.5], 0.3, -0.02, 0.01)
HEAD = Head(3, 1200, 17.250001, POSE)


def street(seed: int = 0, count: int = 6000) -> NDArray[np.float64]:
    """Ground, two walls and something small: points as a sensor sees them."""
    draw = np.random.default_rng(seed)
    ground = np.column_stack(
        [draw.normal(0, 18, (count, 2)).clip(-60, 60), draw.normal(0, 0.02, count)]
    )
    wall = np.column_stack([draw.uniform(-50, 50, count // 4), np.full(count // 4, 15.2),
                            draw.uniform(0, 4, count // 4)])  # fmt: skip
    small = draw.normal((5, 3, 0.9), 0.4, (count // 10, 3))
    return np.concatenate([ground, wall, small])


def test_a_header_comes_back_as_far_as_its_fields_tell() -> None:
    for codec in CODECS:
        told = unpack(pack(Message(HEAD, codec, 4, 9, b"abc" * 50, 1)))
        assert (told.codec, told.packet, told.packets, told.flags) == (codec, 4, 9, 1)
        assert (told.head.node, told.head.frame, told.payload) == (3, 1200, b"abc" * 50)
        assert told.head.stamp_s == pytest.approx(HEAD.stamp_s, abs=5e-7)
        off = told.head.site_SE3_payload
        assert np.abs(off.translation - POSE.translation).max() <= 5.1e-4
        assert np.abs(off.rotation - POSE.rotation).max() <= 3e-6


def test_the_header_is_the_documented_one() -> None:
    data = pack(Message(HEAD, "octree", 4, 9, b"xyz", 1))
    assert len(data) == 58 + 3
    assert data[:4] == b"UTF1"
    assert struct.unpack_from("<BBHIHHq", data, 4) == (2, 1, 3, 1200, 4, 9, 17_250_001)
    assert struct.unpack_from("<3i", data, 24) == (12346, -200001, 4500)
    assert struct.unpack_from("<3i", data, 36) == (300_000, -20_000, 10_000)
    assert struct.unpack_from("<HI", data, 48) == (3, 0)
    assert struct.unpack_from("<I", data, 54)[0] == zlib.crc32(data[:54] + b"xyz")


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        (lambda data: data[:40], "40 bytes"),
        (lambda data: data[:-1], "its header says 3"),
        (lambda data: data + b"!", "its header says 3"),
        (lambda data: b"PNG1" + data[4:], "does not begin with UTF1"),
        (lambda data: b"UTF2" + data[4:], "version '2'"),
        (lambda data: data[:20] + b"\x07" + data[21:], "damaged"),
        (lambda data: data[:-1] + b"!", "damaged"),
    ],
)
def test_a_damaged_message_is_one_clear_error(spoilt: Callable[[bytes], bytes], said: str) -> None:
    data = pack(Message(HEAD, "voxel", 0, 1, b"xyz"))
    with pytest.raises(InputError, match=said) as told:
        unpack(spoilt(data))
    assert "message" in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("with_intensity", [False, True])
@pytest.mark.parametrize("mtu", [600, 65_000])
@pytest.mark.parametrize(
    "codec",
    [
        PointCodec("voxel", edge_m=0.25),
        PointCodec("octree", edge_m=0.25),
        PointCodec("octree", edge_m=0.07),
        PointCodec("draco", bits=9),
        PointCodec("draco", bits=12),
    ],
    ids=str,
)
def test_points_come_back_within_the_bound_of_their_codec(
    codec: PointCodec, mtu: int, with_intensity: bool
) -> None:
    place = street()
    intensity = (place[:, 0] + 60) / 120 if with_intensity else None
    packets = cloud_packets(Points(place, intensity), codec, mtu, HEAD)
    assert max(map(len, packets)) <= mtu
    assert bits_of(packets) == 8 * len(b"".join(packets))
    # From the bytes alone, in any order.
    parts = [cloud_of_payload(unpack(bytes(one))) for one in packets[::-1]]
    back = np.concatenate([one.place for one in parts])
    half = codec.edge_m / 2 if codec.name != "draco" else codec.cube_m / (2**codec.bits - 1) / 2
    assert codec.largest_error_m == pytest.approx(np.sqrt(3) * half)
    away, nearest = cKDTree(back).query(place)
    assert away.max() <= codec.largest_error_m + 1e-5
    assert cKDTree(place).query(back)[0].max() <= codec.largest_error_m + 1e-5
    cells = len(np.unique(np.floor(place / codec.edge_m), axis=0))
    assert len(back) == (len(place) if codec.name == "draco" else cells)
    if intensity is not None:
        told = np.concatenate([one.intensity for one in parts if one.intensity is not None])
        # It grows by 1/120 a metre: no farther off than the points are, and its rounding.
        assert np.abs(told[nearest] - intensity).max() <= 2 * half / 60 + 1 / 255


def test_lost_packets_lose_their_points_and_no_others() -> None:
    place = street()
    packets = cloud_packets(Points(place), PointCodec("octree", edge_m=0.2), 700, HEAD)
    parts = [cloud_of_payload(unpack(one)).place for one in packets]
    assert len(packets) > 15
    every = np.concatenate(parts)
    assert len(np.unique(np.round(every, 6), axis=0)) == len(every)  # no cell in two packets
    assert len(every) == len(np.unique(np.floor(place / 0.2), axis=0))


def test_as_many_packets_are_lost_as_are_to_be() -> None:
    lost = {share: lost_packets(20_000, share, (1, 2, 3)) for share in (0.0, 0.01, 0.2, 0.5, 1.0)}
    for share, one in lost.items():
        sigma = np.sqrt(share * (1 - share) / len(one))
        assert abs(one.mean() - share) <= 4 * sigma
    assert not (lost[0.2] & ~lost[0.5]).any()
    assert (lost_packets(50, 0.5, (1, 2, 3)) == lost[0.5][:50]).all()
    assert (lost_packets(50, 0.5, (2, 2, 3)) != lost[0.5][:50]).any()


@pytest.mark.parametrize("codec", ["voxel", "octree", "draco"])
def test_an_empty_cloud_is_a_message(codec: str) -> None:
    (packet,) = cloud_packets(
        Points(np.zeros((0, 3)), np.zeros(0)),
        PointCodec(codec),
        1400,
        HEAD,  # type: ignore[arg-type]
    )
    assert len(cloud_of_payload(unpack(packet)).place) == 0
    assert len(packet) <= HEADER_BYTES + 45


def features(cells: int = 3000, channels: int = 16) -> FeatureMap:
    draw = np.random.default_rng(1)
    scale = draw.uniform(0.1, 6, channels)
    values = np.maximum(draw.normal(-0.4, 1, (cells, channels)) * scale, 0).astype(np.float32)
    values[:, 3] = 0
    cell = np.sort(draw.choice(200**2, cells, replace=False))
    return FeatureMap(b"8 bytes.", -40.0, -40.0, 0.4, 200, cell, values)


def entropy(symbols: NDArray[np.uint8]) -> float:
    """Shannon's bits of independent symbols."""
    share = np.unique(symbols, return_counts=True)[1] / symbols.size
    return float(-(share * np.log2(share)).sum() * symbols.size)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_values_come_back_within_half_a_step(bits: int) -> None:
    values = features().values
    level, code = quantised(values, bits)
    back = restored(level, code, bits)
    # A step is the greatest value, rounded up to a sixteenth of an octave, over the levels.
    step = values.max(axis=0) * 2 ** (1 / 16) / (2**bits - 1)
    assert (np.abs(back - values).max(axis=0) <= step / 2 + 1e-6).all()
    assert (back[:, 3] == 0).all()


@pytest.mark.parametrize("bits", [2, 4, 8])
def test_features_take_about_as_many_bits_as_they_hold(bits: int) -> None:
    told = features()
    packets = feature_packets(told, bits, 16, 65_000, HEAD)
    back = [features_of_payload(unpack(one)) for one in packets]
    level, code = quantised(told.values, bits)
    assert (np.concatenate([one.cell for one in back]) == told.cell).all()
    assert (np.concatenate([one.values for one in back]) == restored(level, code, bits)).all()
    assert {(one.model, one.x, one.cells) for one in back} == {(b"8 bytes.", -40.0, 200)}
    # Which cells: log2 of how many sets of 3,000 of 40,000 there are. What they say: each channel.
    count, held = 200**2, len(told.cell)
    sets = (
        np.log2(np.arange(count - held + 1, count + 1)).sum()
        - np.log2(np.arange(1, held + 1)).sum()
    )
    shannon = sets + sum(entropy(one) for one in level.T)
    assert shannon <= bits_of(packets) <= 1.1 * shannon


def test_channels_with_most_energy_are_sent() -> None:
    told = features()
    packets = feature_packets(told, 8, 4, 1400, HEAD)
    assert max(map(len, packets)) <= 1400
    back = np.concatenate([features_of_payload(unpack(one)).values for one in packets])
    most = np.argsort(-(told.values.astype(float) ** 2).sum(axis=0))[:4]
    assert set(np.flatnonzero(back.any(axis=0))) == set(most)


def test_many_channels_of_a_large_grid_come_back() -> None:
    draw = np.random.default_rng(3)
    cell = np.array([0, 7, 20_000**2 - 1])
    values = draw.random((3, 512)).astype(np.float32)
    told = FeatureMap(b"8 bytes.", -500.0, -500.0, 0.05, 20_000, cell, values)
    for channels in (512, 300):
        packets = feature_packets(told, 8, channels, 1400, HEAD)
        back = [features_of_payload(unpack(one)) for one in packets]
        assert (np.concatenate([one.cell for one in back]) == cell).all()
        found = np.concatenate([one.values for one in back])
        assert (found.any(axis=0)).sum() == channels
        assert np.abs(found - values)[:, found.any(axis=0)].max() < 2 ** (1 / 16) / 255


def test_nothing_seen_is_a_message_too() -> None:
    none = FeatureMap(b"8 bytes.", 0.0, 0.0, 0.4, 8, np.zeros(0, np.int64),
                      np.zeros((0, 4), np.float32))  # fmt: skip
    (packet,) = feature_packets(none, 4, 4, 1400, HEAD)
    assert features_of_payload(unpack(packet)).values.shape == (0, 4)
    (packet,) = box_packets(boxes(0), 1400, HEAD)
    assert len(boxes_of_payload(unpack(packet))) == 0
    for count in (1, 2):
        for codec in (PointCodec("voxel"), PointCodec("octree"), PointCodec("draco")):
            (packet,) = cloud_packets(Points(np.full((count, 3), 3.3)), codec, 1400, HEAD)
            found = cloud_of_payload(unpack(packet)).place
            assert np.abs(found - 3.3).max() <= codec.largest_error_m


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
    packets = box_packets(told, 500, HEAD)
    assert max(map(len, packets)) <= 500
    back = joined_boxes([boxes_of_payload(unpack(one)) for one in packets])
    assert np.abs(back.box[:, :6] - told.box[:, :6]).max() <= 0.0051
    off = np.angle(np.exp(1j * (back.box[:, 6] - told.box[:, 6])))
    assert np.abs(off).max() <= 2 * np.pi / 65536
    assert (back.kind == told.kind).all()
    assert np.abs(back.score - told.score).max() <= 0.5 / 255 + 1e-9
    assert np.abs(back.rates - told.rates).max() <= 0.0051
    # float16 keeps eleven bits; of x and y the two lines of the matrix, of the others the diagonal.
    assert np.allclose(back.covariance, told.covariance, rtol=2**-11, atol=1e-6)


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


PACKETS = [
    cloud_packets(Points(street(count=300), np.full(405, 0.5)), PointCodec("voxel"), 1400, HEAD)[0],
    cloud_packets(Points(street(count=300)), PointCodec("octree"), 1400, HEAD)[0],
    cloud_packets(Points(street(count=300)), PointCodec("draco"), 1400, HEAD)[0],
    feature_packets(features(40), 4, 8, 1400, HEAD)[0],
    box_packets(boxes(20), 1400, HEAD)[0],
]
READERS = {
    **dict.fromkeys(("voxel", "octree", "draco"), cloud_of_payload),
    "features": features_of_payload,
    **dict.fromkeys(("boxes", "moving"), boxes_of_payload),
}


@given(st.sampled_from(PACKETS), st.data())
def test_payloads_are_not_trusted(packet: bytes, draws: st.DataObject) -> None:
    message = unpack(packet)
    payload = bytearray(message.payload)
    for _ in range(draws.draw(st.integers(1, 4))):
        at = draws.draw(st.integers(0, min(len(payload) - 1, 80)))
        payload[at] = draws.draw(st.integers(0, 255))
    cut = draws.draw(st.integers(0, len(payload)))
    data = bytes(payload[:cut] if draws.draw(st.booleans()) else payload)
    told = unpack(pack(Message(HEAD, message.codec, 0, 1, data, message.flags)))
    try:
        READERS[message.codec](told)
    except InputError as error:
        assert "payload of a message" in str(error)  # noqa: PT017 - or it is read, which is no fault
