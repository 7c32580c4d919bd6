"""Recordings in ROS bags and MCAP files: a sensor's topic, with one frame per message."""

from __future__ import annotations

import shutil
import weakref
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.packets import (
    AXES,
    HEADER_BYTES,
    angles_of,
    hesai_fields,
    metadata_of,
    ouster_recording,
)
from urbantwin.fidelity.readers.packets import TWO_RETURNS as TWO_OF_HESAI
from urbantwin.fidelity.readers.recording import Recording, file_and_choice
from urbantwin.fidelity.readers.tables import LABELS, labels_of_message
from urbantwin.io.bags.files import (
    PACKED,
    ROS1_MAGIC,
    SQLITE_MAGIC,
    Message,
    MessageFile,
    Ros1Bag,
    SqliteBag,
    Topic,
    unpacked_file,
)
from urbantwin.io.bags.mcap import MCAP_MAGIC, McapFile
from urbantwin.io.bags.messages import (
    CLOUDS,
    OUSTER_PACKAGES,
    TRANSFORMS,
    cloud_message,
    is_static,
    place_of_frame,
    ros_message,
    static_transforms,
)
from urbantwin.io.packets.hesai import hesai_form
from urbantwin.io.packets.ouster import (
    OusterFormat,
    ouster_format,
    read_ouster_format,
)
from urbantwin.io.packets.velodyne import TWO_RETURNS as TWO_OF_VELODYNE
from urbantwin.io.packets.velodyne import Velodyne, velodyne_model
from urbantwin.io.trust import laid_out, read_yaml_document, reading
from urbantwin.strict_json import parse_json

__all__ = ["is_mcap", "is_rosbag", "open_bag"]

#: Message types with one packet.
OUSTER = tuple(f"{package}/msg/PacketMsg" for package in OUSTER_PACKAGES)
_OUSTER_PACKET = "a packet of an Ouster"
#: Type and name suffix of the topic with the unit's metadata.
_TEXT, _OUSTER_METADATA = "std_msgs/msg/String", "metadata"
#: Maximum size of packets of the inertial sensor, which have the same message type.
_INERTIAL_BYTES = 256


def is_of_lidar(message: Message) -> bool:
    """Return whether a message is a LiDAR packet, by its size."""
    return len(message.read()) > _INERTIAL_BYTES


def ouster_bag(
    place: tuple[Path, Path, str], packets: Sequence[Message], others: Sequence[Message]
) -> Recording:
    """Return the recording of an Ouster's packets on a topic, with one frame per rotation.

    Args:
        place: the path given by the user, the file, and the layout.
        packets: messages of the topic, in order.
        others: the first message of each topic, one of which may hold the unit's metadata.

    Raises:
        InputError: the unit's metadata are missing, or no packet has the size they state.
    """
    file = place[1]
    form = _form(file, others)

    def headers() -> Iterator[tuple[Message, bytes]]:
        for message in packets:
            packet = _packet(message)
            if len(packet) == form.packet_size:
                yield message, packet[:HEADER_BYTES]

    if next(headers(), None) is None:
        raise InputError(
            f"holds no packet of {form.packet_size} bytes, which the metadata give",
            file=file,
            place=packets[0].topic.name,
            expected="the packets of this sensor",
        )
    return ouster_recording(place, form, headers(), lambda turn: list(map(_packet, turn)))


def _packet(message: Message) -> bytes:
    with reading(message.file.path, _OUSTER_PACKET, str(message)):
        return bytes(ros_message(message.topic, message.read()).buf)


def _form(file: Path, others: Sequence[Message]) -> OusterFormat:
    for message in others:
        topic, file_path = message.topic, message.file.path
        if topic.kind == _TEXT and topic.name.endswith(_OUSTER_METADATA):
            with reading(file_path, "the metadata of an Ouster", str(message)):
                document = parse_json(ros_message(topic, message.read()).data)
            return ouster_format(document, file_path)
    return read_ouster_format(metadata_of(file, "has packets of an Ouster, no topic of metadata"))


#: Message types with the packets of a scan.
PACKETS = (
    "velodyne_msgs/msg/VelodyneScan",
    "pandar_msgs/msg/PandarScan",
    "nebula_msgs/msg/NebulaPackets",
    "hesai_ros_driver/msg/UdpFrame",
)
_SCAN = "the packets of a scan"


class ScanPackets:
    """The decoder of a topic's packets, set up by its first message."""

    def __init__(self, topic: Topic, data: bytes, file: Path, model: str | None) -> None:
        """Read the first message.

        Args:
            topic: topic of the messages.
            data: bytes of the first message.
            file: the file, for errors; the unit's angle correction may be beside it.
            model: model of the sensor, if the user named it.

        Raises:
            InputError: no packets of a known model, or the unit's angles are unknown.
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
            two = any(
                self._form.returns_of(packet) > 1 for packet in packets if self._is_of(packet)
            )
            self.notes = (AXES, *notes, *([TWO_OF_HESAI] if two else []))
        else:
            raise InputError(
                f"has no packets that are known on {topic.name}",
                file=file,
                expected="those of a Velodyne or Hesai",
            )

    def fields(self, data: bytes, place: str) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Return the points of a message as fields, and notes about it.

        Raises:
            InputError: the message is invalid, or has no packet of this sensor.
        """
        packets, stamps = self._packets(data, place)
        if self._form is None:
            return self._velodyne.fields(packets, stamps), ()
        kept = [packet for packet in packets if self._is_of(packet)]
        if not kept:
            raise InputError("has no packets of this sensor", file=self._file, place=place)
        spans = [(0, self._form.blocks // self._form.returns_of(packet)) for packet in kept]
        return hesai_fields(self._form, self._sensor, kept, spans)

    def _is_of(self, packet: bytes) -> bool:
        return hesai_form(packet) == self._form

    def _packets(self, data: bytes, place: str) -> tuple[list[bytes], list[float]]:
        with reading(self._file, _SCAN, place):
            message = ros_message(self._topic, data)
            packets = [
                bytes(packet.data)[: getattr(packet, "size", None) or None]
                for packet in message.packets
            ]
            stamps = [
                packet.stamp.sec + packet.stamp.nanosec / 1e9 if hasattr(packet, "stamp") else 0.0
                for packet in message.packets
            ]
        return packets, stamps


#: Magic bytes, usual suffix and reader of each file format.
_FILES: tuple[tuple[bytes, str, Callable[[Path, Path | None], MessageFile]], ...] = (
    (ROS1_MAGIC, ".bag", Ros1Bag),
    (SQLITE_MAGIC, ".db3", SqliteBag),
    (MCAP_MAGIC, ".mcap", McapFile),
)
_METADATA = "metadata.yaml"
_INFORMATION, _FIRST_BYTES = "rosbag2_bagfile_information", 4096
#: Maximum number of topics in an error message, and of transforms read.
_LISTED, _MOST_TRANSFORMS = 8, 1000


def is_rosbag(path: Path) -> bool:
    """Return whether a path is a ROS 1 or ROS 2 bag, or a folder with one."""
    place, _ = file_and_choice(path)
    if place.is_dir():
        kinds = {_without_packing(one) for one in _files(place)}
        return bool(kinds - {".mcap"}) or _is_of_ros2(place)
    return _ending(place) in (".bag", ".db3")


def is_mcap(path: Path) -> bool:
    """Return whether a path is an MCAP file, or a folder with one."""
    place, _ = file_and_choice(path)
    if place.is_dir():
        return bool(_files(place)) and not is_rosbag(place)
    return _ending(place) == ".mcap"


def open_bag(path: Path, layout: str) -> Recording:
    """Open the clouds of a topic; frames are messages, named by the time of recording.

    Args:
        path: a file, or the folder of a ROS 2 bag; after a colon, the topic
            (``a.mcap:/lidar/points``), and the model if several send the same packets
            (``a.bag:/pandar_packets:OT128``).
        layout: ``rosbag`` or ``mcap``.

    Raises:
        InputError: no such topic, several topics, or a missing or damaged file.
    """
    check_extra("bags", "reading ROS bags and MCAP", file=path)
    place, choice = file_and_choice(path)
    files = [_opened(one) for one in _files_of_one(place)]
    topic, model = _topic(place, files, choice)
    messages = sorted(_messages(files, topic), key=lambda one: one.located.time_ns)
    if topic.kind in OUSTER:
        others = {one for file in files for one in file.messages}
        firsts = [_messages(files, one)[0] for one in others if _messages(files, one)]
        return ouster_bag((path, messages[0].file.path, layout), messages, firsts)
    notes = [note for file in files for note in file.notes]
    if topic.kind in PACKETS:
        scans = ScanPackets(topic, messages[0].read(), messages[0].file.path, model)
        notes += scans.notes
    else:
        notes += _place(files, messages[0])
    names = _names([one.located.time_ns for one in messages])
    labels = {one.located.time_ns: one for one in _of_kind(files, LABELS)}

    def read(index: int) -> Frame:
        message = messages[index]
        data = message.read()
        known: dict[str, Any] = {}
        if topic.kind in PACKETS:
            fields, known["notes"] = scans.fields(data, str(message))
        else:
            cloud = cloud_message(topic, data, message.file.path, str(message))
            fields = cloud.fields
            if cloud.place is not None:
                known["sensor_places"] = cloud.place[None]
        given = {"time_s": fields.pop("time_s")} if "time_s" in fields else {}
        name = names[index]
        beside = labels.get(message.located.time_ns)
        if beside is not None:  # our own export, whose points have these fields
            with laid_out(beside.file.path, str(beside)):
                name, told = labels_of_message(beside.read(), beside.file.path, str(beside))
                known |= told
            given |= {one: fields[one] for one in ("semantic", "instance", "sensor")}
        return frame_of(message.file.path, fields, name=name, given=given, **known)

    return Recording(path, layout, names, read, tuple(notes))


def _files(folder: Path) -> list[Path]:
    endings = {ending for _, ending, _ in _FILES}
    found = (file for file in folder.iterdir() if _without_packing(file) in endings)
    return sorted((item for item in found if item.is_file()), key=counting_order)


def _is_of_ros2(folder: Path) -> bool:
    """Return whether a folder has the metadata of a ROS 2 bag."""
    if not (folder / _METADATA).is_file():
        return False
    with (folder / _METADATA).open("rb") as stream:
        return _INFORMATION.encode() in stream.read(_FIRST_BYTES)


def _without_packing(file: Path) -> str:
    """Return a name's suffix without that of compression: ``.db3`` of ``a.db3.zstd``."""
    return Path(file.name.lower().removesuffix(PACKED)).suffix


def _messages(files: list[MessageFile], topic: Topic) -> list[Message]:
    return [Message(file, topic, one) for file in files for one in file.messages.get(topic, [])]


def _of_kind(files: list[MessageFile], kind: str) -> list[Message]:
    topics = {topic for file in files for topic in file.messages if topic.kind == kind}
    return [one for topic in topics for one in _messages(files, topic)]


def _files_of_one(place: Path) -> list[Path]:
    """Return the files of one bag."""
    if place.is_file():
        return [place]
    found = _files(place)
    if _is_of_ros2(place):
        document = read_yaml_document(place / _METADATA, "the metadata of a ROS 2 bag")
        told = document.get(_INFORMATION) if isinstance(document, dict) else None
        listed = told.get("relative_file_paths") if isinstance(told, dict) else None
        if not isinstance(listed, list):
            raise InputError(
                "lists no files", file=place / _METADATA, place=_INFORMATION,
                expected="relative_file_paths",
            )  # fmt: skip
        names = [Path(str(one)).name for one in listed]
        missing = [name for name in names if not (place / name).is_file()]
        if missing:
            raise InputError(f"{missing[0]} is missing", file=place, expected=", ".join(names[:4]))
        return [place / name for name in names]
    if len(found) != 1:
        names = [item.name for item in found[:_LISTED]]
        raise InputError(
            f"holds {len(found)} files of messages and no {_METADATA} that says they are one",
            file=place,
            expected=f"one: {', '.join(names)}",
        )
    return found


def _ending(file: Path) -> str | None:
    """Return the suffix of a file's format by its content, otherwise by its name."""
    endings = {ending for _, ending, _ in _FILES}
    if not file.is_file():
        return None
    with file.open("rb") as stream:
        start = stream.read(16)
    of_content = (ending for magic, ending, _ in _FILES if start.startswith(magic))
    suffix = _without_packing(file)
    return next(of_content, suffix if suffix in endings else None)


def _opened(file: Path) -> MessageFile:
    ending = _ending(file)
    opens = next((opens for _, one, opens in _FILES if one == ending), None)
    if opens is None:
        raise InputError("is no file of messages", file=file, expected="a .bag, .db3 or .mcap")
    at = unpacked_file(file)
    if at is None:
        return opens(file, None)
    try:
        opened = opens(file, at)
    except BaseException:
        shutil.rmtree(at.parent, ignore_errors=True)
        raise
    weakref.finalize(opened, shutil.rmtree, at.parent, ignore_errors=True)
    return opened


def _topic(place: Path, files: list[MessageFile], choice: str | None) -> tuple[Topic, str | None]:
    """Return the chosen topic, and the model of its sensor if the user named it."""
    count: Counter[Topic] = Counter()
    for file in files:
        for topic, messages in file.messages.items():
            count[topic] += len(messages)
    full = [topic for topic in sorted(count, key=lambda one: one.name) if count[topic]]
    clouds = [one for one in full if one.kind in CLOUDS]
    packets = [one for one in full if one.kind in PACKETS]
    if not clouds + packets:  # LiDAR and inertial packets of Ouster differ in size only
        of_ouster = [one for one in full if one.kind in OUSTER]
        packets = [one for one in of_ouster if is_of_lidar(_messages(files, one)[0])]

    def listed(topics: list[Topic]) -> str:
        told = [
            f"{topic.name} ({topic.kind or 'no type'}, {count[topic]})"
            for topic in topics[:_LISTED]
        ]
        more = len(topics) - _LISTED
        return ", ".join([*told, *([f"{more} more"] if more > 0 else [])])

    if choice is not None:
        name, _, model = choice.partition(":")
        meant = [one for one in full if one.name.strip("/") in (choice.strip("/"), name.strip("/"))]
        if len(meant) == 1 and meant[0].kind in (*CLOUDS, *PACKETS, *OUSTER):
            return meant[0], model or None
        problem = f"has no messages on {choice}"
        if meant:
            kinds = " and ".join(one.kind or "no type" for one in meant)
            problem = f"has {kinds} on {choice}, which is not read"
        expected = listed(clouds + packets) or f"a topic of clouds; it has {listed(full)}"
        raise InputError(problem, file=place, expected=expected)
    # Clouds beside packets are decoded from these packets.
    able = clouds or packets
    if not able:
        cut = any(file.notes for file in files)
        raise InputError(
            "holds no clouds" if full else "was cut" if cut else "holds no messages",
            file=place,
            expected="PointCloud2, foxglove.PointCloud or packets of a LiDAR"
            + (f"; it has {listed(full)}" if full else ""),
        )
    if len(able) > 1:
        raise InputError(
            f"has {len(able)} topics of clouds",
            file=place,
            expected=f"one of {listed(able)}, as {place.name}:{able[0].name}",
        )
    return able[0], None


def _place(files: list[MessageFile], first: Message) -> list[str]:
    """Return a note about the pose of the points' frame, if the bag has its transforms."""
    topics = {topic for file in files for topic in file.messages}
    told_of = [one for one in topics if one.kind == TRANSFORMS and is_static(one.name)]
    static = [one for topic in told_of for one in _messages(files, topic)][:_MOST_TRANSFORMS]
    if not static:
        return []
    try:
        cloud = cloud_message(first.topic, first.read(), first.file.path, str(first))
        with reading(first.file.path, "transforms"):
            told = static_transforms(
                ros_message(message.topic, message.read()) for message in static
            )
    except InputError:  # raised again when the frame is read
        return []
    found = place_of_frame(cloud.frame_id, told)
    return [] if found is None else [found]


def _names(times_ns: list[int]) -> tuple[str, ...]:
    """Return the frames' names: their times, numbered if several are equal."""
    seen: Counter[int] = Counter()
    names = []
    for time in times_ns:
        names.append(str(time) if not seen[time] else f"{time}-{seen[time]}")
        seen[time] += 1
    return tuple(names)
