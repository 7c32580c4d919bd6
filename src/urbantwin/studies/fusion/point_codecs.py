"""Point clouds in packets: voxels, an octree, or Draco.

Voxels: the occupied cells of a cubic lattice as a sorted list. Octree: the same cells as which of
eight children each node has, level by level (D. Meagher, "Geometric modeling using octree
encoding", 1982; R. Schnabel and R. Klein, "Octree-based Point-Cloud Compression", 2006). Both give
back the middles of cells, at most half a cell's diagonal from every point. Draco (Google, bitstream
2.2, by way of DracoPy): every point, each coordinate rounded to one of 2^bits values along a cube.
Cells and occupancies are entropy-coded by Zstandard, Draco has its own coder (rANS).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.reconstruct.gltf.draco import unpack_draco
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.studies.fusion.message import Head, Message
from urbantwin.studies.fusion.packets import in_packets
from urbantwin.studies.fusion.payload import (
    bad_payload,
    byte_planes,
    compressed,
    decompressed,
    of_byte_planes,
    unpacked,
)

__all__ = ["PointCodec", "Points", "cloud_of_payload", "cloud_packets", "morton_order", "voxels_of"]

#: Edge of a cell, its lowest numbers in x, y and z, how many cells, bytes of a step or levels of
#: the tree, bytes before and after compression.
_CELLS = struct.Struct("<f3iIBII")
#: How many points.
_DRACO = struct.Struct("<I")
#: Bits of each coordinate that a Morton number has place for.
_MOST_BITS = 21
_INTENSITY = 1


@dataclass(frozen=True, eq=False)
class Points:
    """A cloud.

    Attributes:
        place: (N, 3) float64, metres.
        intensity: (N,) float64, 0..1; None where it is not told.
    """

    place: NDArray[np.float64]
    intensity: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class PointCodec:
    """How points are told.

    Attributes:
        name: of the codec.
        edge_m: of voxels and of an octree's leaves, metres.
        bits: of a coordinate of Draco's.
        cube_m: edge of the cube about the node in which Draco counts, metres.
    """

    name: Literal["voxel", "octree", "draco"]
    edge_m: float = 0.1
    bits: int = 11
    cube_m: float = 128.0

    @property
    def largest_error_m(self) -> float:
        """No point comes back farther from where it was, metres (rounding of float32 apart)."""
        if self.name == "draco":
            return float(np.sqrt(3) / 2 * self.cube_m / (2**self.bits - 1))
        return float(np.sqrt(3) / 2 * self.edge_m)


def cloud_packets(
    points: Points,
    codec: PointCodec,
    mtu: int,
    head: Head,
) -> list[bytes]:
    """Return a cloud as packets.

    Args:
        points: in the frame of the payload.
        codec: how.
        mtu: bytes that a packet may have.
        head: of the frame.

    Raises:
        InputError: the packets are too small, or the points too far apart for the cells.
    """
    if codec.name == "draco":
        half = codec.cube_m / 2
        inside = np.asarray((np.abs(points.place) < half).all(axis=1))
        # Draco's library makes one of points at the very same place.
        single = np.unique(points.place.astype(np.float32), axis=0, return_index=True)[1]
        points = _some(points, np.sort(single[inside[single]]))
        step = codec.cube_m / (2**codec.bits - 1)
        ordered = _some(points, morton_order(np.floor((points.place + half) / step)))
    else:
        cells, ordered = voxels_of(points, codec.edge_m)

    def encoded(begin: int, end: int) -> bytes:
        part = None if ordered.intensity is None else ordered.intensity[begin:end]
        told = None if part is None else np.rint(255 * np.clip(part, 0, 1)).astype(np.uint8)
        if codec.name == "draco":
            return _draco(ordered.place[begin:end], told, codec)
        return _cells(cells[begin:end], told, codec)

    return in_packets(
        codec.name,
        len(ordered.place),
        encoded,
        mtu,
        head,
        0 if points.intensity is None else _INTENSITY,
    )


def cloud_of_payload(message: Message) -> Points:
    """Return the points of one packet, in the frame of the payload.

    Raises:
        InputError: the payload is not what the codec writes.
    """
    tells = bool(message.flags & _INTENSITY)
    if message.codec == "draco":
        return _of_draco(message.payload, tells=tells)
    if message.codec not in ("voxel", "octree"):
        raise bad_payload(f"is of codec {message.codec}, which tells no points")
    (edge, *low, count, size, whole, length), rest = unpacked(_CELLS, message.payload)
    if not 0 < edge < 1e3 or not np.isfinite(edge) or len(rest) < length:
        raise bad_payload(f"has cells of {edge:g} m and {len(rest)} of {length:g} bytes")
    body, rest = rest[: int(length)], rest[int(length) :]
    read = _of_list if message.codec == "voxel" else _of_occupancies
    cells = read(decompressed(body, int(whole)), int(count), int(size))
    intensity = None
    if tells:
        intensity = np.frombuffer(decompressed(rest, int(count)), np.uint8) / 255.0
    middles = (cells + np.array(low, np.int64) + 0.5) * float(edge)
    return Points(np.asarray(middles, np.float64), intensity)


def voxels_of(points: Points, edge_m: float) -> tuple[NDArray[np.int64], Points]:
    """Return the occupied cells (M, 3) in Morton order, and their middles with mean intensities.

    Args:
        points: the cloud.
        edge_m: of a cell.

    Raises:
        InputError: the cells are too small for how far the points reach.
    """
    every = np.floor(points.place / float(np.float32(edge_m))).astype(np.int64)
    if not len(every):
        none = None if points.intensity is None else np.zeros(0)
        return np.zeros((0, 3), np.int64), Points(np.zeros((0, 3)), none)
    low = every.min(axis=0)
    code, first, owner = np.unique(_morton(every - low), return_index=True, return_inverse=True)
    cells = every[first]
    intensity = None
    if points.intensity is not None:
        count = np.bincount(owner, minlength=len(code))
        intensity = np.bincount(owner, points.intensity, len(code)) / count
    middles = np.asarray((cells + 0.5) * float(np.float32(edge_m)), np.float64)
    return cells, Points(middles, intensity)


def morton_order(cells: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return the order (N,) of cells (N, 3) along Morton's curve: neighbours stay together."""
    if not len(cells):
        return np.zeros(0, np.int64)
    whole = cells.astype(np.int64)
    return np.asarray(np.argsort(_morton(whole - whole.min(axis=0)), kind="stable"), np.int64)


def _some(points: Points, rows: NDArray[np.int64]) -> Points:
    intensity = None if points.intensity is None else points.intensity[rows]
    return Points(points.place[rows], intensity)


def _morton(cells: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Return the bits of cells (N, 3), none below zero, interleaved: x lowest, then y, then z."""
    if len(cells) and cells.max() >> _MOST_BITS:
        raise InputError(
            f"has {int(cells.max())} cells along an axis",
            place="codec",
            expected=f"cells so large that 2^{_MOST_BITS} reach from one end to the other",
        )
    code = np.zeros(len(cells), np.uint64)
    for axis in range(3):
        code |= _spread(cells[:, axis].astype(np.uint64)) << np.uint64(axis)
    return code


_MASKS = ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
          (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249))  # fmt: skip


def _spread(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return 21 bits with two zeros after each (S. E. Anderson, "Bit Twiddling Hacks")."""
    value = value & np.uint64(0x1FFFFF)
    for shift, mask in _MASKS:
        value = (value | value << np.uint64(shift)) & np.uint64(mask)
    return value


def _gathered(code: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return every third bit: what `_spread` was given."""
    value = code & np.uint64(_MASKS[-1][1])
    masks = [mask for _, mask in _MASKS[-2::-1]] + [0x1FFFFF]
    for (shift, _), mask in zip(_MASKS[::-1], masks, strict=True):
        value = (value | value >> np.uint64(shift)) & np.uint64(mask)
    return value


def _cells_of(code: NDArray[np.uint64]) -> NDArray[np.int64]:
    return np.column_stack(
        [_gathered(code >> np.uint64(axis)).astype(np.int64) for axis in range(3)]
    )


def _cells(cells: NDArray[np.int64], told: NDArray[np.uint8] | None, codec: PointCodec) -> bytes:
    """Return the payload of some cells (N, 3) with intensities (N,)."""
    low = cells.min(axis=0) if len(cells) else np.zeros(3, np.int64)
    # A part of a curve about another corner is another curve: the cells are sorted anew.
    code = _morton(cells - low)
    order = np.argsort(code)
    size, plain = (_listed if codec.name == "voxel" else _occupancies)(code[order])
    data = compressed(plain)
    head = _CELLS.pack(codec.edge_m, *low.tolist(), len(cells), size, len(plain), len(data))
    return head + data + (b"" if told is None else compressed(told[order].tobytes()))


def _listed(code: NDArray[np.uint64]) -> tuple[int, bytes]:
    step = np.diff(code, prepend=np.uint64(0))
    size = max(1, (int(step.max(initial=0)).bit_length() + 7) // 8)
    return size, byte_planes(step, size)


def _of_list(plain: bytes, count: int, size: int) -> NDArray[np.int64]:
    if not 1 <= size <= 8 or len(plain) != count * size:
        raise bad_payload(f"has {len(plain)} bytes for {count} cells of {size}")
    return _cells_of(np.cumsum(of_byte_planes(plain, size), dtype=np.uint64))


def _occupancies(code: NDArray[np.uint64]) -> tuple[int, bytes]:
    depth = (int(code.max(initial=0)).bit_length() + 2) // 3
    levels = []
    for _ in range(depth):
        parent, first = np.unique(code >> np.uint64(3), return_index=True)
        child = np.uint8(1) << (code & np.uint64(7)).astype(np.uint8)
        levels.append(np.bitwise_or.reduceat(child, first).astype(np.uint8))
        code = parent
    return depth, b"".join(one.tobytes() for one in levels[::-1])


def _of_occupancies(plain: bytes, count: int, depth: int) -> NDArray[np.int64]:
    told = np.frombuffer(plain, np.uint8)
    code, at = np.zeros(min(count, 1), np.uint64), 0
    for _ in range(min(depth, _MOST_BITS)):
        here = told[at : at + len(code)]
        if len(here) < len(code):
            raise bad_payload("ends within its octree")
        at += len(code)
        node, child = np.nonzero(np.unpackbits(here[:, None], axis=1, bitorder="little"))
        code = (code[node] << np.uint64(3)) | child.astype(np.uint64)
        if len(code) > count:
            raise bad_payload(f"has more leaves than the {count} that it says")
    if at != len(told) or len(code) != count:
        raise bad_payload(f"has {len(code)} leaves where {count} are said")
    return _cells_of(code)


def _draco(place: NDArray[np.float64], told: NDArray[np.uint8] | None, codec: PointCodec) -> bytes:
    check_extra("gltf", "packing points with Draco")
    import DracoPy

    if not len(place):
        return _DRACO.pack(0)
    data: bytes = DracoPy.encode(
        np.ascontiguousarray(place, np.float32),
        quantization_bits=codec.bits,
        compression_level=7,
        quantization_range=codec.cube_m,
        quantization_origin=[-codec.cube_m / 2] * 3,
        generic_attributes=None if told is None else {1: np.ascontiguousarray(told[:, None])},
    )
    return _DRACO.pack(len(place)) + data


def _of_draco(payload: bytes, *, tells: bool) -> Points:
    (count,), rest = unpacked(_DRACO, payload)
    if not count:
        return Points(np.zeros((0, 3)), np.zeros(0) if tells else None)
    try:
        attributes, _ = unpack_draco(rest)
    except MalformedError as error:
        raise bad_payload(f"is broken: {error}") from None
    by_width = {one.shape[1]: one for one in attributes.values() if len(one) == count}
    if 3 not in by_width or (tells and 1 not in by_width):
        raise bad_payload(f"does not have the {count:g} points that it says")
    told = by_width[1].reshape(-1) / 255.0 if tells else None
    return Points(by_width[3].astype(np.float64), told)
