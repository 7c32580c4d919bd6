"""Messages that hold the packets of one scan, as drivers of Velodynes and Hesais record them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.fidelity.readers.bags.message_file import Topic, as_input_error
from urbantwin.fidelity.readers.bags.ros_types import ros_message
from urbantwin.fidelity.readers.hesai import AXES, angles_of, hesai_fields
from urbantwin.fidelity.readers.hesai import TWO_RETURNS as TWO_OF_HESAI
from urbantwin.fidelity.readers.hesai_packets import hesai_form
from urbantwin.fidelity.readers.velodyne import TWO_RETURNS as TWO_OF_VELODYNE
from urbantwin.fidelity.readers.velodyne import Velodyne, velodyne_model

__all__ = ["PACKETS", "ScanPackets"]

#: Types of messages that hold a scan's packets.
PACKETS = (
    "velodyne_msgs/msg/VelodyneScan",
    "pandar_msgs/msg/PandarScan",
    "nebula_msgs/msg/NebulaPackets",
    "hesai_ros_driver/msg/UdpFrame",
)
_EXPECTED = "the packets of a scan"


class ScanPackets:
    """The decoder of a topic's packets, made by its first message."""

    def __init__(self, topic: Topic, data: bytes, file: Path, model: str | None) -> None:
        """Look at the first message.

        Args:
            topic: what the messages are.
            data: the bytes of the first.
            file: for errors; beside it lies what belongs to the unit.
            model: of the sensor, where a person said it.

        Raises:
            InputError: it has no packets that are known, or the unit's angles are not known.
        """
        self._topic, self._file = topic, file
        packets, _ = self._packets(data, "the first message")
        of_velodyne = Counter(filter(None, map(velodyne_model, packets)))
        self._form = next(filter(None, map(hesai_form, packets)), None)
        if of_velodyne:
            self._velodyne = Velodyne(of_velodyne.most_common(1)[0][0], file, packets)
            two = any(map(self._velodyne.has_two_returns, packets))
            self.notes = (*self._velodyne.notes, *([TWO_OF_VELODYNE] if two else []))
        elif self._form is not None:
            self._sensor, notes = angles_of(
                self._form.models, file, model, choice=f"{file.name}:{topic.name}"
            )
            two = any(self._form.returns_of(one) > 1 for one in packets if self._is_of(one))
            self.notes = (AXES, *notes, *([TWO_OF_HESAI] if two else []))
        else:
            raise InputError(
                f"has no packets that are known on {topic.name}",
                file=file,
                expected="those of a Velodyne or Hesai",
            )

    def fields(self, data: bytes, place: str) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Return the points of a message with what is known of each, and notes on it.

        Raises:
            InputError: it is no such message, or has no packet of this sensor.
        """
        packets, stamps = self._packets(data, place)
        if self._form is None:
            return self._velodyne.fields(packets, stamps), ()
        kept = [one for one in packets if self._is_of(one)]
        if not kept:
            raise InputError("has no packets of this sensor", file=self._file, place=place)
        spans = [(0, self._form.blocks // self._form.returns_of(one)) for one in kept]
        return hesai_fields(self._form, self._sensor, kept, spans)

    def _is_of(self, packet: bytes) -> bool:
        return hesai_form(packet) == self._form

    def _packets(self, data: bytes, place: str) -> tuple[list[bytes], list[float]]:
        with as_input_error(self._file, _EXPECTED, place):
            message = ros_message(self._topic, data)
            packets = [
                bytes(one.data)[: getattr(one, "size", None) or None] for one in message.packets
            ]
            stamps = [
                one.stamp.sec + one.stamp.nanosec / 1e9 if hasattr(one, "stamp") else 0.0
                for one in message.packets
            ]
        return packets, stamps
