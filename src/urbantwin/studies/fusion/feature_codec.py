"""Feature maps in packets: the cells that matter, quantised, entropy-coded.

Of each cell that is sent its number, and of each channel whether its value is zero and, if it is
not, its level. Levels are even steps from 0 to the channel's greatest value, which is told as a
power of two to a sixteenth. Cells' numbers, zeros and levels are each a Zstandard frame: Huffman
and finite state entropy codes (RFC 8878). Values must not be below zero: those of a rectifier.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

__all__ = ["FeatureMap", "feature_packets", "features_of_payload", "quantised", "restored"]

#: Model, south-western corner, edge of a cell, cells along a side, bits, channels that are sent and
#: channels that there are, cells that are sent, bytes of the three compressed parts and of the
#: levels before compression.
_HEAD = struct.Struct("<8s3fHBHHIHHHI")
#: A channel's greatest value is 2 to the power of (code - 128) / 16; code 0: it is zero everywhere.
_MIDDLE, _STEPS = 128, 16.0


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Some cells of a square grid with what a network knows of them.

    Attributes:
        model: eight bytes that tell the network from others.
        x: of the grid's south-western corner in the frame of the payload, metres.
        y: of that corner.
        cell_m: edge of a cell.
        cells: along each side.
        cell: (K,) int64 which cells, row by row from the south-west, ascending.
        values: (K, C) float32, none below zero.
    """

    model: bytes
    x: float
    y: float
    cell_m: float
    cells: int
    cell: NDArray[np.int64]
    values: NDArray[np.float32]


def quantised(
    values: NDArray[np.float32], bits: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the levels (K, C) of values, 0 to 2^bits - 1, and the code of each channel's greatest.

    Args:
        values: none below zero.
        bits: of a level, 1 to 8.
    """
    most = values.max(axis=0, initial=0.0)
    with np.errstate(divide="ignore"):
        code = np.ceil(_STEPS * np.log2(most, dtype=np.float64) + _MIDDLE - 1e-6)
    code = np.where(most > 0, np.clip(code, 1, 255), 0).astype(np.uint8)
    levels = 2**bits - 1
    share = values / np.maximum(_greatest(code), 1e-30)
    return np.rint(np.clip(share, 0, 1) * levels).astype(np.uint8), code


def restored(level: NDArray[np.uint8], code: NDArray[np.uint8], bits: int) -> NDArray[np.float32]:
    """Return values (K, C) of levels: at most half a step from what `quantised` was given."""
    return np.asarray(level * (_greatest(code) / (2**bits - 1)), np.float32)


def feature_packets(
    found: FeatureMap,
    bits: int,
    channels: int,
    mtu: int,
    head: Head,
) -> list[bytes]:
    """Return a map as packets.

    Args:
        found: the map.
        bits: of a level, 1 to 8.
        channels: so many are sent, those with most energy (sum of squares) in this frame.
        mtu: bytes that a packet may have.
        head: of the frame.
    """
    energy = (found.values.astype(np.float64) ** 2).sum(axis=0)
    sent = np.sort(np.argsort(-energy, kind="stable")[:channels])
    level, code = quantised(found.values[:, sent], bits)
    which = sent.astype("<u2").tobytes() if len(sent) < found.values.shape[1] else b""

    def encoded(begin: int, end: int) -> bytes:
        some = level[begin:end]
        step = np.diff(found.cell[begin:end], prepend=0).astype(np.uint64)
        there = some.T != 0  # channel by channel: neighbouring cells are alike
        parts = [
            compressed(byte_planes(step, 4)),
            compressed(np.packbits(there).tobytes()),
            compressed(some.T[there].tobytes()),
        ]
        sizes = [min(len(one), 65_535) for one in parts]
        head = _HEAD.pack(
            found.model, found.x, found.y, found.cell_m, found.cells, bits, len(sent),
            found.values.shape[1], len(some), *sizes, int(there.sum()),
        )  # fmt: skip
        return head + which + code.tobytes() + b"".join(parts)

    return in_packets(
        "features",
        len(found.cell),
        encoded,
        mtu,
        head,
    )


def features_of_payload(message: Message) -> FeatureMap:
    """Return the cells of one packet; channels that were not sent are zero.

    Raises:
        InputError: the payload is not what the codec writes.
    """
    if message.codec != "features":
        raise bad_payload(f"is of codec {message.codec}, which tells no features")
    told, rest = unpacked(_HEAD, message.payload)
    model: bytes = told[0]
    x, y, cell_m = told[1:4]
    cells, bits, sent, channels, count, *sizes, filled = (int(one) for one in told[4:])
    numbers = (x, y, cell_m)
    if not (np.isfinite(numbers).all() and 0 < cell_m < 100 and 1 <= bits <= 8 and cells):
        raise bad_payload(f"has {cells} cells of {cell_m:g} m and {bits} bits")
    if not 1 <= sent <= channels:
        raise bad_payload(f"has {sent} of {channels} channels")
    which = np.arange(sent)
    if sent < channels:
        if len(rest) < 2 * sent:
            raise bad_payload("ends within its channels")
        which, rest = np.frombuffer(rest[: 2 * sent], "<u2"), rest[2 * sent :]
    code, rest = np.frombuffer(rest[:sent], np.uint8), rest[sent:]
    if len(which) < sent or len(code) < sent or (which >= channels).any():
        raise bad_payload("ends within its channels")
    if len(rest) != sum(sizes):
        raise bad_payload(f"has {len(rest)} bytes of values where {sum(sizes)} are said")
    ends = np.cumsum(sizes)
    parts = [rest[end - size : end] for size, end in zip(sizes, ends, strict=True)]
    cell = np.cumsum(of_byte_planes(decompressed(parts[0], 4 * count), 4)).astype(np.int64)
    if (cell >= cells**2).any():
        raise bad_payload("has a cell outside of its grid")
    there = np.frombuffer(decompressed(parts[1], (count * sent + 7) // 8), np.uint8)
    mask = np.unpackbits(there)[: count * sent].astype(bool).reshape(sent, count)
    if int(mask.sum()) != filled:
        raise bad_payload(f"has {int(mask.sum())} values where {filled} are said")
    level = np.zeros((sent, count), np.uint8)
    level[mask] = np.frombuffer(decompressed(parts[2], filled), np.uint8)
    if (level >> bits).any():
        raise bad_payload(f"has a level of more than {bits} bits")
    values = np.zeros((count, channels), np.float32)
    values[:, which] = restored(level.T, code, bits)
    return FeatureMap(model, x, y, cell_m, cells, cell, values)


def _greatest(code: NDArray[np.uint8]) -> NDArray[np.float64]:
    return np.where(code > 0, 2.0 ** ((code.astype(np.float64) - _MIDDLE) / _STEPS), 0.0)
