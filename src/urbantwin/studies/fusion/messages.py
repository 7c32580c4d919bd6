"""Messages between nodes: quantised integers in packets, and the bytes that these take.

A cloud is the set of occupied cells of a cubic lattice, features are levels of each channel in even
steps up to its greatest value, boxes are fixed-point numbers. Every packet holds as many rows as
fit and can be decoded without the others: its integers column by column, each by the significance
of its bytes, packed by Zstandard (RFC 8878, level 19, without magic number and checksum), behind a
header. The packing is lossless, so receivers here take the integers as they are; the bytes are
packed to be counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np
import zstandard
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import Pose, rotation_from_ypr, wrapped, ypr_from_rotation
from urbantwin.studies.fusion.boxes import Boxes

__all__ = [
    "HEADER_BYTES", "Content", "FeatureMap", "Points", "Sent", "quantised_boxes", "quantised_cloud",
    "quantised_features", "reported_pose", "sent",
]  # fmt: skip

#: Version, kind, node, frame, packet of how many, time stamp, pose, length, checksum, reserve.
HEADER_BYTES = 58
#: A packet whose first guess is too full is tried again with this share of what would fit.
_SHRINK = 0.97
#: Cells of a cloud are numbered block by block, so that a packet holds one part of the scene.
_BLOCK = 16
#: Codes of a channel's greatest value: 2 to the power of (code - 128) / 16; 0 for zero everywhere.
_MIDDLE, _STEPS = 128, 16.0
#: Integers of a turn of half a circle.
_TURN = 32768 / np.pi
#: Standard deviations where covariance is not sent: place and height, m; yaw, rad; speed, m/s;
#: rate of turn, rad/s (of pedestrians the second component of the velocity, m/s).
_PLACE_M, _HEIGHT_M, _YAW, _SPEED_M_S, _TURNS = 0.5, 0.3, 0.3, 5.0, 1.0

Rows = NDArray[Any]


class _Selectable(Protocol):
    """Rows that a message carries."""

    def only(self, chosen: NDArray[np.bool_]) -> Self:
        """Return some of the rows."""


Content = TypeVar("Content", bound="_Selectable")


@dataclass(frozen=True, eq=False)
class Points:
    """A cloud: ``place`` (N, 3) in metres, ``intensity`` (N,) 0..1 or None."""

    place: NDArray[np.float64]
    intensity: NDArray[np.float64] | None = None

    def only(self, chosen: NDArray[np.bool_]) -> Points:
        """Return some of the points."""
        intensity = None if self.intensity is None else self.intensity[chosen]
        return Points(self.place[chosen], intensity)


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Some cells of a square grid with a network's features of them.

    Attributes:
        x, y: of the grid's south-western corner, metres.
        cell_m: edge of a cell.
        cells: along each side.
        cell: (K,) int64 numbers of the cells, row by row from the south-west, ascending.
        values: (K, C) float32, none below zero.
    """

    x: float
    y: float
    cell_m: float
    cells: int
    cell: NDArray[np.int64]
    values: NDArray[np.float32]

    def only(self, chosen: NDArray[np.bool_]) -> FeatureMap:
        """Return some of the cells."""
        grid = self.x, self.y, self.cell_m, self.cells
        return FeatureMap(*grid, self.cell[chosen], self.values[chosen])


@dataclass(frozen=True, eq=False)
class Sent(Generic[Content]):
    """One frame of a node in packets.

    Attributes:
        content: as receivers restore it, in the frame of the message.
        packet: (N,) packet that each row of it is in.
        sizes: (P,) bytes of the packets, headers included.
        site_SE3_content: pose of the frame of the message, as the node reports it.
        stamp_s: when the frame was taken by the node's clock, seconds.
    """

    content: Content
    packet: NDArray[np.int64]
    sizes: NDArray[np.int64]
    site_SE3_content: Pose  # noqa: N815
    stamp_s: float

    @property
    def bits(self) -> int:
        """Bits of all packets, headers included."""
        return 8 * int(self.sizes.sum())


def reported_pose(pose: Pose) -> Pose:
    """Return a pose as a header has it: to a millimetre and a microradian."""
    angles = np.round(ypr_from_rotation(pose.rotation), 6)
    return Pose(rotation_from_ypr(*angles), np.round(pose.translation, 3))


def sent(
    quantised: tuple[Content, Rows, int], mtu: int, site_SE3_content: Pose, stamp_s: float
) -> Sent[Content]:
    """Return a frame in packets.

    Args:
        quantised: the content as it is restored, its integers (N,) and the bytes that each packet
            needs beside them: what `quantised_cloud` and its like return.
        mtu: largest size of a packet, bytes.
        site_SE3_content: reported pose of the frame of the content.
        stamp_s: the node's clock; sent in microseconds.

    Raises:
        InputError: not even one row fits into a packet.
    """
    content, rows, about = quantised
    room = mtu - HEADER_BYTES - about
    packet = np.zeros(len(rows), np.int64)
    sizes: list[int] = []
    begin, guess = 0, max(len(rows), 1)
    while begin < len(rows) or not sizes:
        count = min(guess, len(rows) - begin)
        size = _packed_size(rows[begin : begin + count])
        while size > room:
            if count <= 1:
                expected = f"at least {size + about + HEADER_BYTES} bytes"
                raise InputError(f"one row takes {size} bytes", place="--mtu", expected=expected)
            count = max(1, min(count - 1, int(count * _SHRINK * room / size)))
            size = _packed_size(rows[begin : begin + count])
        packet[begin : begin + count] = len(sizes)
        sizes.append(HEADER_BYTES + about + size)
        begin += count
        guess = max(1, int(count * room / max(size, 1)))
    pose = reported_pose(site_SE3_content)
    return Sent(content, packet, np.array(sizes), pose, round(stamp_s, 6))


def _packed_size(rows: Rows) -> int:
    """Return the bytes of rows (N,): packed, or plain where that is shorter.

    Of levels, which are mostly zero, it is packed which are not, and then these.
    """
    names, parts = rows.dtype.names or (), []
    if "key" in names:
        rows = rows.copy()
        rows["key"] = np.diff(rows["key"], prepend=rows["key"].dtype.type(0))
    if "level" in names:
        level = np.ascontiguousarray(rows["level"].T)
        parts = [np.packbits(level != 0), level[level != 0]]
        rows = np.ascontiguousarray(rows["key"])
    table = rows.view(np.uint8).reshape(len(rows), rows.dtype.itemsize)
    parts.append(np.ascontiguousarray(table.T))
    packed = sum(len(_packer().compress(part.tobytes())) for part in parts)
    return int(min(packed, sum(part.nbytes for part in parts)))


@cache
def _packer() -> zstandard.ZstdCompressor:
    bare = zstandard.ZstdCompressionParameters.from_level(
        19, write_content_size=False, format=zstandard.FORMAT_ZSTD1_MAGICLESS
    )
    return zstandard.ZstdCompressor(compression_params=bare)


def quantised_cloud(points: Points, edge_m: float) -> tuple[Points, Rows, int]:
    """Return the middles of the occupied cells with mean intensities, and their integers.

    Args:
        points: in the frame of the message.
        edge_m: of a cell; no point is farther from its middle than half the diagonal.
    """
    form = [("key", "<u8")] + ([] if points.intensity is None else [("intensity", "u1")])
    about = 4 * 8  # the edge, the lowest cell, the number of blocks along each axis, the count
    if not len(points.place):
        return points, np.zeros(0, form), about
    cell = np.floor(points.place / edge_m).astype(np.int64)
    low = cell.min(axis=0)
    block, within = np.divmod(cell - low, _BLOCK)
    shape = tuple((block.max(axis=0) + 1)[::-1].tolist())
    number = np.ravel_multi_index(tuple(block.T[::-1]), shape) * _BLOCK**3
    number += np.ravel_multi_index(tuple(within.T[::-1]), (_BLOCK,) * 3)
    key, first, owner = np.unique(number, return_index=True, return_inverse=True)
    rows = np.zeros(len(key), form)
    rows["key"] = key
    intensity = None
    if points.intensity is not None:
        mean = np.bincount(owner, points.intensity) / np.bincount(owner)
        rows["intensity"] = np.rint(255 * np.clip(mean, 0, 1))
        intensity = rows["intensity"] / 255.0
    middles = np.asarray((cell[first] + 0.5) * edge_m, np.float64)
    return Points(middles, intensity), rows, about


def quantised_features(
    features: FeatureMap, bits: int, channels: int
) -> tuple[FeatureMap, Rows, int]:
    """Return a map with the values that its levels stand for, and its integers.

    A level is at most half a step off; channels that are not sent are zero.

    Args:
        features: in the frame of the message.
        bits: of a level, 1 to 8.
        channels: number that is sent: those with most energy (sum of squares) in this frame.
    """
    values = features.values
    energy = (values.astype(np.float64) ** 2).sum(axis=0)
    which = np.sort(np.argsort(-energy, kind="stable")[:channels])
    most = values[:, which].max(axis=0, initial=0.0).astype(np.float64)
    with np.errstate(divide="ignore"):
        code = np.clip(np.ceil(_STEPS * np.log2(most) + _MIDDLE - 1e-6), 1, 255)
    step = np.where(most > 0, 2.0 ** ((code - _MIDDLE) / _STEPS), 0.0) / (2**bits - 1)
    rows = np.zeros(len(values), [("key", "<u4"), ("level", "u1", (len(which),))])
    rows["key"] = features.cell
    share = values[:, which] / np.maximum(step, 1e-30)
    rows["level"] = np.rint(np.clip(share, 0, 2**bits - 1))
    restored = np.zeros_like(values)
    restored[:, which] = rows["level"] * step
    # The grid, and of each channel its greatest value, and its number where some are left out.
    about = 20 + len(which) * (1 if len(which) == values.shape[1] else 3)
    grid = features.x, features.y, features.cell_m, features.cells
    return FeatureMap(*grid, features.cell, restored), rows, about


def quantised_boxes(
    boxes: Boxes, *, motion: bool = True, covariance: bool = True
) -> tuple[Boxes, Rows, int]:
    """Return boxes as their integers have them, and these: 16 bytes a box, up to 34.

    Places and sizes are in centimetres, yaw in 2 pi / 65536, scores in 255ths. Where motion is not
    sent, boxes are at rest; where covariance is not sent, it is a usual one.

    Args:
        boxes: in the frame of the message, at most 327 m from its origin.
        motion: send the rates: cm/s, of a rate of turn mrad/s.
        covariance: send of x and y the covariance, of z, yaw and rates the variances (float16).
    """
    form: list[Any] = [("kind", "u1"), ("score", "u1"), ("place", "<i2", 3), ("size", "<u2", 3),
                       ("yaw", "<i2")]  # fmt: skip
    form += [("rates", "<i2", 2)] * motion + [("spread", "<f2", 7)] * covariance
    rows = np.zeros(len(boxes), form)
    rows["kind"] = boxes.kind
    rows["score"] = np.rint(255 * np.clip(boxes.score, 0, 1))
    rows["place"] = np.rint(np.clip(boxes.box[:, :3], -327, 327) * 100)
    rows["size"] = np.rint(np.clip(boxes.box[:, 3:6], 0.01, 655) * 100)
    rows["yaw"] = np.rint(wrapped(boxes.box[:, 6]) * _TURN).astype(np.int64).astype(np.int16)
    box = np.column_stack([rows["place"] / 100.0, rows["size"] / 100.0, rows["yaw"] / _TURN])
    walks = boxes.is_pedestrian
    rates = np.zeros((len(boxes), 2))
    if motion:
        unit = np.where(walks[:, None], 100.0, [100.0, 1000.0])
        rows["rates"] = np.rint(np.clip(boxes.rates * unit, -32767, 32767))
        rates = rows["rates"] / unit
    spread = np.tile(np.diag(np.square([_PLACE_M, _PLACE_M, _HEIGHT_M, _YAW, _SPEED_M_S, _TURNS])),
                     (len(boxes), 1, 1))  # fmt: skip
    spread[walks, 5, 5] = _SPEED_M_S**2
    if covariance:
        a, b = [0, 0, 1, 2, 3, 4, 5], [0, 1, 1, 2, 3, 4, 5]
        rows["spread"] = np.clip(boxes.covariance[:, a, b], -6e4, 6e4)
        spread[:, a, b] = spread[:, b, a] = rows["spread"]
    restored = Boxes(box, boxes.kind, rows["score"] / 255.0, rates, spread)
    return restored, rows, 3
