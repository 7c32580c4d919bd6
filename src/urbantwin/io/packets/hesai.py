"""Packets of Hesai's spinning sensors: the models that send them, and the layout of their bytes.

Sources: the structures of Hesai's own reader (HesaiLidar_SDK_2.0, ``libhesai/UdpProtocol``) and
those of Autoware's (tier4/nebula, ``nebula_decoders_hesai/decoders``); both follow the models' user
manuals, "Point Cloud Data Packet". All numbers are little-endian.

    Pandar40P, 40M        blocks of FF EE, azimuth, 40 returns; tail
    Pandar64              EE FF, lasers, blocks, -, unit of distance, -, -; blocks; tail
    protocols 1.4 to 6.1  EE FF, protocol (2), - (2), lasers, blocks, first return, unit of
                          distance, returns, flags; blocks; of 1.4 and 3.2 a checksum (4) and what
                          for functional safety (17); tail

A block is an azimuth (2, hundredths of a degree, clockwise) and, for each channel, a distance (2),
a reflectivity (1) and up to two bytes more.
"""

from __future__ import annotations

import calendar
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["HesaiForm", "Returns", "hesai_form", "unread_protocol"]

#: (protocol, lasers, blocks) -> models with such packets.
_MODELS: dict[tuple[tuple[int, int], int, int], tuple[str, ...]] = {
    ((1, 4), 128, 2): ("Pandar128", "OT128"),
    ((1, 4), 90, 2): ("Pandar90",),
    ((3, 1), 64, 4): ("PandarQT",),
    ((3, 2), 128, 2): ("QT128",),
    ((6, 1), 32, 8): ("PandarXT-32",),
    ((6, 1), 16, 8): ("PandarXT-16",),
    ((6, 1), 32, 6): ("XT32M2X",),
}
#: Protocol -> interval between firings of a channel, microseconds.
_PERIOD_US = {(1, 4): 55.556, (3, 1): 500 / 3, (3, 2): 111.11, (6, 1): 50.0}
#: State in the tail of a Pandar128 or OT128 that fires twice as often, and its period.
_HIGH_RESOLUTION, _HIGH_RESOLUTION_US = 0, 27.778
_PANDAR_40, _PANDAR_64 = ("Pandar40P", "Pandar40M"), ("Pandar64",)
_PANDAR_US = 55.56
#: Header flags of 1.4 and 3.2 for optional parts of the packet.
_SEQUENCE, _IMU, _SAFETY, _SIGNED = 0x01, 0x02, 0x04, 0x08
#: Return modes with two and with three returns; all others have one.
_TWO_RETURNS, _THREE_RETURNS = (0x39, 0x3A, 0x3B, 0x3C, 0x3E), (0x3D,)
#: Minimum distance; smaller ones mean no return (an OT128 gives the reason as a code).
_LEAST_DISTANCE = 4


@dataclass(frozen=True)
class HesaiForm:
    """The layout of a packet.

    Attributes:
        models: models that send such packets, by their names in the catalogue.
        lasers: number of channels.
        blocks: number of blocks per packet.
        size: minimum number of bytes.
        body: byte offset of the first block's azimuth.
        stride: bytes from block to block.
        unit: bytes per return.
        distance_m: unit of distances, metres.
        mode: byte offset of the return mode.
        stamp: byte offset of the microseconds.
        date: byte offset of the date, six bytes.
        year: base year of dates.
        period_us: interval between firings of a channel, microseconds.
        state: byte offset of the operating state, if it changes the period.
    """

    models: tuple[str, ...]
    lasers: int
    blocks: int
    size: int
    body: int
    stride: int
    unit: int
    distance_m: float
    mode: int
    stamp: int
    date: int
    year: int
    period_us: float
    state: int | None = None

    def azimuth_deg(self, packet: bytes | memoryview) -> list[float]:
        """Return the azimuth of each block of a packet, degrees clockwise."""
        at = range(self.body, self.body + self.blocks * self.stride, self.stride)
        return [int.from_bytes(packet[k : k + 2], "little") / 100 for k in at]

    def returns_of(self, packet: bytes | memoryview) -> int:
        """Return the number of returns per firing in a packet, stored in consecutive blocks."""
        mode = packet[self.mode]
        count = 2 if mode in _TWO_RETURNS else 3 if mode in _THREE_RETURNS else 1
        return count if self.blocks % count == 0 else 1

    def microseconds(self, packet: bytes) -> int:
        """Return the time of a packet by the sensor's clock, microseconds since 1970."""
        date = packet[self.date : self.date + 6]
        try:
            # or big-endian seconds since 1970
            whole = (
                calendar.timegm((self.year + date[0], *date[1:6]))
                if date[0]
                else int.from_bytes(date[1:6], "big")
            )
        except ValueError:  # a month or day out of range: the clock was not set
            whole = 0
        return whole * 10**6 + int.from_bytes(packet[self.stamp : self.stamp + 4], "little")

    def firings(self, packets: Sequence[bytes]) -> Returns:
        """Return the first return of every firing in packets, one row each."""
        joined = b"".join(packet[: self.size] for packet in packets)
        table = np.frombuffer(joined, np.uint8).reshape(len(packets), self.size)
        body = table[:, self.body : self.body + self.blocks * self.stride]
        block = body.reshape(-1, self.stride)
        unit = block[:, 2 : 2 + self.lasers * self.unit].reshape(len(block), self.lasers, self.unit)
        azimuth = block[:, 0].astype(np.int64) + 256 * block[:, 1].astype(np.int64)
        distance = unit[:, :, 0].astype(np.int64) + 256 * unit[:, :, 1].astype(np.int64)
        # The number of blocks per firing may differ between packets.
        count = np.repeat([self.returns_of(packet) for packet in packets], self.blocks)
        number = np.tile(np.arange(self.blocks), len(packets))
        firing = number // count
        before_last = self.blocks // count - 1 - firing
        period = np.full(len(packets), self.period_us)
        if self.state is not None:
            period[table[:, self.state] == _HIGH_RESOLUTION] = _HIGH_RESOLUTION_US
        sent = np.array([self.microseconds(packet) for packet in packets])
        time = np.repeat((sent - sent[0]).astype(np.float64), self.blocks)
        time -= before_last * np.repeat(period, self.blocks)
        first = number % count == 0
        return Returns(
            azimuth_deg=azimuth[first] / 100,
            range_m=np.where(distance < _LEAST_DISTANCE, 0, distance)[first] * self.distance_m,
            intensity=unit[first, :, 2].astype(np.int64),
            time_s=time[first] * 1e-6,
        )


@dataclass(frozen=True, eq=False)
class Returns:
    """Returns of firings.

    Attributes:
        azimuth_deg: (F,) azimuth of each firing, degrees clockwise.
        range_m: (F, C) range of each channel, metres; 0 without a return.
        intensity: (F, C) 0..255.
        time_s: (F,) time of each firing, seconds since the first packet was sent.
    """

    azimuth_deg: NDArray[np.float64]
    range_m: NDArray[np.float64]
    intensity: NDArray[np.int64]
    time_s: NDArray[np.float64]


def hesai_form(packet: bytes | memoryview) -> HesaiForm | None:
    """Return the layout of a packet; None if it is of another model."""
    size, start = len(packet), bytes(packet[:12])
    if start[:2] == b"\xff\xee" and size in (1262, 1266):
        every = range(0, 1240, 124)
        return _PANDAR_40_FORM if all(packet[k : k + 2] == b"\xff\xee" for k in every) else None
    if len(start) < 12 or start[:2] != b"\xee\xff":
        return None
    form = _form(start, size)
    return form if form is not None and size >= form.size else None


def unread_protocol(packet: bytes | memoryview) -> str | None:
    """Return the unsupported Hesai protocol of a packet; None if it is no such packet."""
    if len(packet) < 100 or bytes(packet[:2]) != b"\xee\xff" or hesai_form(packet) is not None:
        return None
    return f"Hesai's protocol {packet[2]}.{packet[3]}" if max(packet[2:4]) < 10 else None


_PANDAR_40_FORM = HesaiForm(
    models=_PANDAR_40, lasers=40, blocks=10, size=1262, body=2, stride=124, unit=3,
    distance_m=0.004, mode=1254, stamp=1250, date=1256, year=2000, period_us=_PANDAR_US,
)  # fmt: skip


@lru_cache(256)
def _form(start: bytes, size: int) -> HesaiForm | None:
    if start[2:4] == bytes([64, 6]):
        return HesaiForm(
            models=_PANDAR_64, lasers=64, blocks=6, size=1194, body=8, stride=194, unit=3,
            distance_m=start[5] / 1000, mode=1186, stamp=1182, date=1188, year=2000,
            period_us=_PANDAR_US,
        )  # fmt: skip
    protocol, lasers, blocks, flags = (start[2], start[3]), start[6], start[7], start[11]
    models = _MODELS.get((protocol, lasers, blocks))
    if models is None:
        return None
    checked = protocol in ((1, 4), (3, 2))
    unit = _unit(size, lasers, blocks, flags) if checked else 4
    stride = 2 + unit * lasers
    tail = 12 + blocks * stride + (4 + 17 * bool(flags & _SAFETY) if checked else 0)
    # From the tail's first byte: return mode, microseconds, date, its end.
    mode, stamp, date, end = (16, 12, 18, 24) if protocol == (3, 1) else (10, 19, 13, 24)
    if checked:
        mode, stamp, date, end = 12, 21, 15, 26
    return HesaiForm(
        models=models, lasers=lasers, blocks=blocks, size=tail + end, body=12, stride=stride,
        unit=unit, distance_m=start[9] / 1000, mode=tail + mode, stamp=tail + stamp,
        date=tail + date, year=1900, period_us=_PERIOD_US[protocol],
        state=tail + 11 if protocol == (1, 4) else None,
    )  # fmt: skip


def _unit(size: int, lasers: int, blocks: int, flags: int) -> int:
    """Return the bytes per return: as many as fit the packet's size."""
    beside = 12 + 4 + 26 + 4 + sum(
        count for bit, count in ((_SEQUENCE, 4), (_IMU, 22), (_SAFETY, 17), (_SIGNED, 32))
        if flags & bit
    )  # fmt: skip
    by_flags = 3 + bool(flags & 0x10) + bool(flags & 0x20)
    fits = [unit for unit in (3, 4, 5) if beside + blocks * (2 + unit * lasers) == size]
    return fits[0] if fits else by_flags
