"""Packets of Velodyne sensors: the model that sent them, their azimuths, and their points.

A packet has 1206 bytes: twelve blocks of a flag, an azimuth in hundredths of a degree and 32 pairs
of distance and intensity; then a time, the return mode and the model ("VLP-16 User Manual", 9.3).
It is decoded by `velodyne-decoder`, with its calibration of the model.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.io.child import read_in_child

__all__ = [
    "PACKET_BYTES",
    "TWO_RETURNS",
    "Velodyne",
    "azimuth_deg",
    "unread_model",
    "velodyne_model",
]

PACKET_BYTES = 1206
TWO_RETURNS = "Of two returns of a beam the stronger is read."
#: The model's byte in a packet (manuals, "Factory bytes").
_MODELS = {
    0x21: "HDL-32E",
    0x22: "VLP-16",
    0x23: "VLP-32A or B",
    0x24: "VLP-16 Hi-Res",
    0x28: "VLP-32C",
    0xA1: "VLS-128",
}
_HDL_64E = "HDL-64E"
#: Its series, and published calibrations in the decoder.
_OTHER_64E = {"HDL64E_S2": "HDL-64E_S2.1-sztaki.yml", "HDL64E_S3": "HDL-64E_S3-VeloView.yml"}
_FLAGS = struct.Struct("<" + "H98x" * 12)
_AZIMUTHS = struct.Struct("<" + "2xH96x" * 12)
_UPPER, _LOWER = 0xEEFF, 0xDDFF
_DUAL = 0x39
_HOUR_S = 3600.0
#: Range limits of the decoder, metres.
_NEAREST_M, _FARTHEST_M = 0.0, 1000.0


def velodyne_model(packet: bytes | memoryview) -> str | None:
    """Return the model that sent a packet; None if it is of none of these."""
    if len(packet) != PACKET_BYTES or bytes(packet[:2]) != b"\xff\xee":
        return None
    flags = _FLAGS.unpack_from(packet)
    if max(_AZIMUTHS.unpack_from(packet)) >= 36000:
        return None
    # An HDL-64E has its status in the bytes of mode and model; its halves alternate.
    if flags[:4] == (_UPPER, _LOWER, _UPPER, _LOWER):
        return _HDL_64E
    return _MODELS.get(packet[PACKET_BYTES - 1])


def unread_model(packet: bytes | memoryview) -> str | None:
    """Return the unsupported model of a packet in Velodyne's layout."""
    if len(packet) != PACKET_BYTES or bytes(packet[:2]) != b"\xff\xee":
        return None
    return f"a Velodyne of model {packet[PACKET_BYTES - 1]:#04x}"


def azimuth_deg(packet: bytes | memoryview) -> float:
    """Return the azimuth of the first block of a packet, degrees clockwise."""
    return float(_AZIMUTHS.unpack_from(packet)[0]) / 100


class Velodyne:
    """The decoder of one unit's packets."""

    def __init__(self, model: str, file: Path, packets: Iterable[bytes] = ()) -> None:
        """Determine the decoder's settings.

        Args:
            model: result of `velodyne_model`.
            file: the file, for errors.
            packets: packets of the recording, which may contain an HDL-64E's calibration.

        Raises:
            InputError: the packets do not determine the model's beams.
        """
        check_extra("bags", "reading Velodyne packets", file=file)
        self.model = model
        self.notes: tuple[str, ...] = ()
        self._file = file
        self._calibration: str | None = None
        self._decoder_model: str | None = None
        if model == _HDL_64E:
            self._decoder_model, self._calibration = _hdl_64e(packets)
            if self._calibration is None:
                other = _OTHER_64E[self._decoder_model]
                self._calibration = _published(other)
                self.notes = (
                    "The HDL-64E's calibration is not whole in its packets: that of another unit "
                    f"({other}) stands for it.",
                )
        elif " or " in model:
            raise InputError(
                f"is of a {model}, which its packets do not tell apart",
                file=file,
                expected="packets of another model",
            )

    def fields(
        self, packets: Sequence[bytes], stamps_s: Sequence[float]
    ) -> dict[str, NDArray[np.generic]]:
        """Return the points of a rotation: x (forward), y (left), z and other fields.

        Args:
            packets: packets of one rotation, in order.
            stamps_s: their times of capture, seconds.

        Raises:
            InputError: no packet is of this model, or decoding fails.
        """
        own = [
            (packet, stamp)
            for packet, stamp in zip(packets, stamps_s, strict=True)
            if velodyne_model(packet) == self.model
        ]
        if not own:  # not checked by the decoder
            raise InputError(f"has no packet of a {self.model}", file=self._file)
        points = read_in_child(
            "urbantwin.io.packets.velodyne:_decoded", own, self._decoder_model, self._calibration,
            file=self._file, size=PACKET_BYTES * len(own), expected="packets of a Velodyne",
        )  # fmt: skip
        points = points[_stronger(points)]
        # The sensor's clock restarts every hour.
        time = points["time"].astype(np.float64)
        time = (time + _HOUR_S / 2) % _HOUR_S - _HOUR_S / 2
        return {name: points[name] for name in ("x", "y", "z", "intensity", "ring", "column")} | {
            "time_s": time - time.min() if len(time) else time
        }

    def has_two_returns(self, packet: bytes) -> bool:
        """Return whether a packet has two returns of each beam."""
        if self.model == _HDL_64E:
            azimuth = _AZIMUTHS.unpack_from(packet)
            return bool(azimuth[0] == azimuth[2])
        return packet[PACKET_BYTES - 2] == _DUAL


def _decoded(
    packets: list[tuple[bytes, float]], model: str | None, calibration: str | None
) -> NDArray[np.void]:
    """Return the points of packets and their time stamps, in the child process."""
    import velodyne_decoder as decoder

    settings: dict[str, Any] = {
        "min_range": _NEAREST_M,
        "max_range": _FARTHEST_M,
        "timestamp_first_packet": True,
    }
    if model is not None:
        settings["model"] = getattr(decoder.Model, model)
    if calibration is not None:
        settings["calibration"] = decoder.Calibration.from_string(calibration)
    vector = decoder.PacketVector(
        [decoder.VelodynePacket(stamp, list(packet)) for packet, stamp in packets]
    )
    _, points = decoder.ScanDecoder(decoder.Config(**settings)).decode(vector, True)
    return np.array(points)


def _stronger(points: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the indices of the stronger return of each beam, in order.

    If the last return is the strongest, the other one in the packet is the second strongest
    ("VLP-16 User Manual", 6.1.3).
    """
    beam = points["column"].astype(np.int64) * 256 + points["ring"]
    # of two equal returns, the one labelled strongest, which comes second
    order = np.lexsort((-np.arange(len(points)), -points["intensity"], beam))
    return np.sort(order[np.unique(beam[order], return_index=True)[1]])


def _published(name: str) -> str:
    from velodyne_decoder import get_bundled_calibration

    text: str = get_bundled_calibration(name).to_string()
    return text


def _hdl_64e(packets: Iterable[bytes]) -> tuple[str, str | None]:
    """Return the series and the calibration that an HDL-64E transmits byte by byte."""
    import yaml
    from velodyne_decoder import hdl64e

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            told = hdl64e.status_info_to_calib_dict(hdl64e.read_status_info(packets))
    except (ValueError, KeyError, struct.error, IndexError):
        return "HDL64E_S3", None
    series = "HDL64E_S2" if told["status"].pop("Model") == "S2" else "HDL64E_S3"
    lasers = [one["laser_id"] for one in told["lasers"]]
    if told["status"]["Calibration Time"] is None or lasers != list(range(64)):
        return series, None
    return series, yaml.safe_dump({key: told[key] for key in told if key != "status"})
