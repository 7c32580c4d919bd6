"""Messages between nodes: quantised integers in packets, and their size in bytes.

A cloud is the set of occupied cells of a cubic lattice; features are quantised per channel in even
steps up to the channel's maximum; boxes are fixed-point numbers. Every packet holds as many rows as
fit and can be decoded independently: a header, then its integers column by column, byte plane by
byte plane, compressed by Zstandard (RFC 8878, level 19, without magic number and checksum).
Compression is lossless, so receivers here use the integers directly; packets are compressed only to
count bytes.
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

#: Version, kind, node, frame, packet number and count, time stamp, pose, length, checksum, reserve.
HEADER_BYTES = 58
#: Factor on the estimated number of rows when a packet was too large.
_SHRINK = 0.97
#: Cells of a cloud are numbered block by block, so that a packet covers one part of the scene.
_BLOCK = 16
#: Codes of a channel's greatest value: 2 to the power of (code - 128) / 16; 0 for zero everywhere.
_MIDDLE, _STEPS = 128, 16.0
#: Integers of a turn of half a circle.
_TURN = 32768 / np.pi
#: Default standard deviations if covariance is not sent: position and height, m; yaw, rad; speed,
#: m/s; yaw rate, rad/s (for pedestrians the second component of the velocity, m/s).
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
    """Some cells of a square grid, with a network's features.

    Attributes:
        x, y: south-western corner of the grid, metres.
        cell_m: edge of a cell, metres.
        cells: number of cells along each side.
        cell: (K,) int64 numbers of the cells, row by row from the south-west, ascending.
        values: (K, C) float32, non-negative.
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
    """A frame of a node in packets.

    Attributes:
        content: content as restored by receivers, in the message's frame.
        packet: (N,) packet of each row.
        sizes: (P,) bytes of the packets, headers included.
        site_SE3_content: pose of the message's frame, as reported by the node.
        stamp_s: time of the frame by the node's clock, seconds.
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
    """Return a pose at the precision of a header: millimetres and microradians."""
    angles = np.round(ypr_from_rotation(pose.rotation), 6)
    return Pose(rotation_from_ypr(*angles), np.round(pose.translation, 3))


def sent(
    quantised: tuple[Content, Rows, int], mtu: int, site_SE3_content: Pose, stamp_s: float
) -> Sent[Content]:
    """Return a frame divided into packets.

    Args:
        quantised: the restored content, its integers (N,), and the additional bytes of each packet,
            as from `quantised_cloud`.
        mtu: largest size of a packet, bytes.
        site_SE3_content: reported pose of the frame of the content.
        stamp_s: time by the node's clock, seconds; sent in microseconds.

    Raises:
        InputError: a single row does not fit into a packet.
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
    """Return the size of rows (N,), bytes: compressed, or raw if smaller.

    For feature levels, which are mostly zero, a bit mask of non-zero levels is followed by these.
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
    """Return the centres of occupied cells with mean intensities, and their integers.

    Args:
        points: points in the message's frame.
        edge_m: edge of a cell, metres; no point is farther from its centre than half the diagonal.
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
    """Return a map with quantised values, and its integers.

    The quantisation error is at most half a step; channels that are not sent are zero.

    Args:
        features: map in the message's frame.
        bits: bits per level, 1 to 8.
        channels: number of channels to send: those with most energy (sum of squares) in this frame.
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
    # The grid, each channel's maximum, and channel numbers if some are omitted.
    about = 20 + len(which) * (1 if len(which) == values.shape[1] else 3)
    grid = features.x, features.y, features.cell_m, features.cells
    return FeatureMap(*grid, features.cell, restored), rows, about


def quantised_boxes(
    boxes: Boxes, *, motion: bool = True, covariance: bool = True
) -> tuple[Boxes, Rows, int]:
    """Return quantised boxes and their integers, 16 to 34 bytes per box.

    Positions and sizes are in centimetres, yaw in 2 pi / 65536, scores in 1/255. Without motion,
    boxes are at rest; without covariance, a default is assumed.

    Args:
        boxes: boxes in the message's frame, at most 327 m from its origin.
        motion: send rates: cm/s, yaw rates in mrad/s.
        covariance: send the covariance of x and y, and the variances of z, yaw and rates (float16).
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
