"""Packets of Ouster sensors: layout of their columns, by the unit's metadata.

Source: Ouster, "Firmware user manual", LiDAR data packet formats, and ouster-sdk, ``parsing.cpp``
(BSD-3). A packet has a header, columns and a footer; a column has its time, its number in the
rotation, its validity, and a pixel for each channel.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.io.trust import laid_out, read_json_document

__all__ = ["OusterFormat", "Scan", "ouster_format", "read_ouster_format"]

_EXPECTED = "the metadata of an Ouster sensor"
_SECTIONS = (
    "beam_intrinsics",
    "lidar_intrinsics",
    "config_params",
    "lidar_data_format",
    "data_format",
    "sensor_info",
)


@dataclass(frozen=True)
class _Pixel:
    """A pixel of a profile: size in bytes, mask of its range and range step in millimetres."""

    size: int
    mask: int
    step_mm: int
    reflectivity_at: int
    returns: int = 1


_PROFILES = {
    "LEGACY": _Pixel(12, 0xFFFFF, 1, 4),
    "RNG19_RFL8_SIG16_NIR16": _Pixel(12, 0x7FFFF, 1, 4),
    "RNG19_RFL8_SIG16_NIR16_DUAL": _Pixel(16, 0x7FFFF, 1, 3, returns=2),
    "RNG15_RFL8_NIR8": _Pixel(4, 0x7FFF, 8, 2),
    "RNG15_RFL8_NIR8_DUAL": _Pixel(8, 0x7FFF, 8, 2, returns=2),
    "RNG15_RFL8_WIN8": _Pixel(4, 0x7FFF, 8, 2),
    "RNG15_RFL8_NIR8_ZONE16": _Pixel(8, 0x7FFF, 8, 2),
    "RNG19_RFL8_SIG16_NIR16_ZONE16": _Pixel(12, 0x7FFFF, 1, 4),
    "RNG19_RFL8_SIG16_ZONE16_DUAL": _Pixel(16, 0x7FFFF, 1, 3, returns=2),
    "RNG19_RFL8_SIG16_NIR16_RGB16": _Pixel(16, 0x7FFFF, 1, 3),
    "FUSA_RNG15_RFL8_NIR8_DUAL": _Pixel(8, 0x7FFF, 8, 2, returns=2),
}


@dataclass(frozen=True, eq=False)
class Scan:
    """One rotation: range (H, W) in metres, 0 without a return, and other values of pixels.

    Attributes:
        range_m: (H, W) metres, from the beam's origin; the first return if there are two.
        reflectivity: (H, W) calibrated, 0..255.
        time_s: (W,) seconds since the first valid column of the rotation; NaN for missing columns.
    """

    range_m: NDArray[np.float64]
    reflectivity: NDArray[np.float64]
    time_s: NDArray[np.float64]

    @property
    def columns(self) -> int:
        """Number of received columns."""
        return int(np.isfinite(self.time_s).sum())


@dataclass(frozen=True, eq=False)
class OusterFormat:
    """Packet format and beam directions of a unit.

    Attributes:
        profile: profile of the packets in the metadata.
        altitude, azimuth: (H,) beam angles, radians, azimuth clockwise from the encoder's.
        columns: columns per rotation.
        columns_per_packet: columns per packet.
        beam_mm: (2,) beam origin: distance from the axis and height.
        sensor_from_lidar: (4, 4) transform to the sensor frame, millimetres.
        has_safety_header: whether packets have a header of functional safety (FUSA).
    """

    profile: str
    altitude: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    columns: int
    columns_per_packet: int
    beam_mm: NDArray[np.float64]
    sensor_from_lidar: NDArray[np.float64]
    has_safety_header: bool = False

    @property
    def returns(self) -> int:
        """Returns per pixel: 1 or 2."""
        return self._pixel.returns

    @property
    def packet_size(self) -> int:
        """Bytes of one LiDAR packet."""
        return 2 * self._around + self.columns_per_packet * self._column_type.itemsize

    def frame_id(self, packet: bytes) -> int:
        """Return the number of a packet's rotation."""
        if self._is_legacy:
            return int.from_bytes(packet[10:12], "little")
        if self.has_safety_header:
            return int.from_bytes(packet[4:8], "little")
        return int.from_bytes(packet[2:4], "little")

    def scan(self, packets: list[bytes]) -> Scan:
        """Return the rotation of the packets of one frame."""
        shape = (len(self.altitude), self.columns)
        millimetres = np.zeros(shape)
        reflectivity = np.zeros(shape)
        time_ns = np.full(self.columns, -1, np.int64)
        for packet in packets:
            columns = np.frombuffer(
                packet, self._column_type, self.columns_per_packet, self._around
            )
            valid = (columns["status"] & 1).astype(bool) & (columns["number"] < self.columns)
            columns = columns[valid]
            number = columns["number"].astype(np.int64)
            time_ns[number] = columns["time"].astype(np.int64)
            pixel = columns["pixel"]
            millimetres[:, number] = self._pixel.step_mm * (pixel["range"] & self._pixel.mask).T
            reflectivity[:, number] = pixel["reflectivity"].T
        came = time_ns >= 0
        time_s = np.full(self.columns, np.nan)
        if came.any():
            time_s[came] = (time_ns[came] - time_ns[came].min()) * 1e-9
        return Scan(millimetres / 1000, reflectivity, time_s)

    def points(self, range_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (H, W, 3) of ranges (H, W) in the sensor frame, metres.

        Ranges include the distance of the beam origin from the axis; a range of 0 is no point.
        """
        out, up = self.beam_mm / 1000
        theta = 2 * np.pi * (1 - np.arange(self.columns) / self.columns)[None, :]
        angle = theta - self.azimuth[:, None]
        along = range_m - np.hypot(out, up)
        flat = along * np.cos(self.altitude)[:, None]
        lidar = np.stack(
            [
                flat * np.cos(angle) + out * np.cos(theta),
                flat * np.sin(angle) + out * np.sin(theta),
                along * np.sin(self.altitude)[:, None] + up,
            ],
            axis=-1,
        )
        matrix = self.sensor_from_lidar
        return np.asarray(lidar @ matrix[:3, :3].T + matrix[:3, 3] / 1000)

    @property
    def _pixel(self) -> _Pixel:
        return _PROFILES[self.profile]

    @property
    def _is_legacy(self) -> bool:
        return self.profile == "LEGACY"

    @property
    def _around(self) -> int:
        """Size of a packet's header, and of its footer, bytes."""
        return 0 if self._is_legacy else 32

    @property
    def _column_type(self) -> np.dtype[np.void]:
        one = self._pixel
        pixel = np.dtype(
            {
                "names": ["range", "reflectivity"],
                "formats": ["<u4", "u1"],
                "offsets": [0, one.reflectivity_at],
                "itemsize": one.size,
            }
        )
        header = 16 if self._is_legacy else 12
        size = header + len(self.altitude) * one.size + (4 if self._is_legacy else 0)
        return np.dtype(
            {
                "names": ["time", "number", "status", "pixel"],
                "formats": ["<u8", "<u2", "<u2", (pixel, len(self.altitude))],
                "offsets": [0, 8, size - 4 if self._is_legacy else 10, header],
                "itemsize": size,
            }
        )


def read_ouster_format(path: Path) -> OusterFormat:
    """Return the packet format of a unit's metadata file, of any firmware.

    Raises:
        InputError: it is no such metadata, or has an unknown profile.
    """
    return ouster_format(read_json_document(path, _EXPECTED), path)


def ouster_format(document: Any, path: Path) -> OusterFormat:  # noqa: ANN401 - any JSON
    """Return the packet format of a unit's metadata.

    Args:
        document: the metadata.
        path: its file, for errors.

    Raises:
        InputError: it is no such metadata, or has an unknown profile.
    """
    with laid_out(path, _EXPECTED):
        values: dict[str, Any] = dict(document)
        for section in _SECTIONS:
            values |= document.get(section) or {}
        altitude = np.radians(np.array(values["beam_altitude_angles"], np.float64))
        azimuth = np.radians(np.array(values["beam_azimuth_angles"], np.float64))
        mode = re.search(r"(\d+)x\d+", str(values.get("lidar_mode", "")))
        columns = values.get("columns_per_frame") or int(mode[1] if mode else 1024)
        profile = str(values.get("udp_profile_lidar", "LEGACY")).removeprefix("PROFILE_LIDAR_")
        out = float(values.get("lidar_origin_to_beam_origin_mm", 0.0))
        begin = values.get("beam_to_lidar_transform")
        matrix = values.get("lidar_to_sensor_transform", np.diag([-1.0, -1.0, 1.0, 1.0]))
        if altitude.shape != azimuth.shape or altitude.ndim != 1 or not len(altitude):
            raise ValueError(f"{altitude.size} altitudes and {azimuth.size} azimuths")
        beam = np.array([out, 0.0] if begin is None else np.reshape(begin, (4, 4))[[0, 2], 3])
        found = OusterFormat(
            profile=profile,
            altitude=altitude,
            azimuth=azimuth,
            columns=int(columns),
            columns_per_packet=int(values.get("columns_per_packet", 16)),
            beam_mm=beam.astype(np.float64),
            sensor_from_lidar=np.array(matrix, np.float64).reshape(4, 4),
            # older metadata state it in the profile
            has_safety_header=values.get("header_type", profile).startswith("FUSA"),
        )
    if profile not in _PROFILES:
        raise InputError(
            f"{profile} is unknown",
            file=path,
            place="udp_profile_lidar",
            expected=", ".join(_PROFILES),
        )
    if not 1 <= found.columns <= 65536 or not 1 <= found.columns_per_packet <= 1024:
        raise InputError("has no columns", file=path, expected=_EXPECTED)
    return found
