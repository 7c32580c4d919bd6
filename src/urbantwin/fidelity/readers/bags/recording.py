"""The recording in a bag: which topic it is, and its frames one message each."""

from __future__ import annotations

import shutil
import weakref
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.bags import mcap_file, ros1, sqlite
from urbantwin.fidelity.readers.bags.cloud_message import CLOUDS, cloud_message
from urbantwin.fidelity.readers.bags.message_file import (
    Message,
    MessageFile,
    Topic,
    as_input_error,
)
from urbantwin.fidelity.readers.bags.ouster_bag import OUSTER, is_of_lidar, ouster_bag
from urbantwin.fidelity.readers.bags.packet_message import PACKETS, ScanPackets
from urbantwin.fidelity.readers.bags.ros_types import ros_message
from urbantwin.fidelity.readers.bags.transforms import (
    TRANSFORMS,
    is_static,
    place_of_frame,
    static_transforms,
)
from urbantwin.fidelity.readers.bags.unpacking import PACKED, unpacked_file
from urbantwin.fidelity.readers.documents import laid_out, read_yaml_document
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.recording import Recording, file_and_choice
from urbantwin.fidelity.readers.tables import LABELS, labels_of_message

__all__ = ["is_mcap", "is_rosbag", "open_bag"]

#: First bytes of files of messages, their usual endings, and what reads them.
_FILES: tuple[tuple[bytes, str, Callable[[Path, Path | None], MessageFile]], ...] = (
    (ros1.MAGIC, ".bag", ros1.Ros1Bag),
    (sqlite.MAGIC, ".db3", sqlite.SqliteBag),
    (mcap_file.MAGIC, ".mcap", mcap_file.McapFile),
)
_METADATA = "metadata.yaml"
_INFORMATION, _FIRST_BYTES = "rosbag2_bagfile_information", 4096
#: Topics that a line lists, and transforms that are looked at.
_LISTED, _MOST_TRANSFORMS = 8, 1000


def is_rosbag(path: Path) -> bool:
    """Return whether a path is a bag of ROS 1 or ROS 2, or a folder that is one or holds one."""
    place, _ = file_and_choice(path)
    if place.is_dir():
        kinds = {_without_packing(one) for one in _files(place)}
        return bool(kinds - {".mcap"}) or _is_of_ros2(place)
    return _ending(place) in (".bag", ".db3")


def is_mcap(path: Path) -> bool:
    """Return whether a path is an MCAP file, or a folder that holds one."""
    place, _ = file_and_choice(path)
    if place.is_dir():
        return bool(_files(place)) and not is_rosbag(place)
    return _ending(place) == ".mcap"


def open_bag(path: Path, layout: str) -> Recording:
    """Open the clouds of a topic; a frame is one message, called by when it was recorded.

    Args:
        path: a file, or the folder of a bag of ROS 2; behind a colon, which topic
            (``a.mcap:/lidar/points``), and of packets that several models send, which
            (``a.bag:/pandar_packets:OT128``).
        layout: as which it is opened.

    Raises:
        InputError: there is no such topic, or several; or a file is missing or damaged.
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
        if beside is not None:  # ours: so are the fields of its points
            with laid_out(beside.file.path, str(beside)):
                name, told = labels_of_message(beside.read(), beside.file.path, str(beside))
                known |= told
            given |= {one: fields[one] for one in ("semantic", "instance", "sensor")}
        return frame_of(message.file.path, fields, name=name, given=given, **known)

    return Recording(path, layout, names, read, tuple(notes))


def _files(folder: Path) -> list[Path]:
    endings = {ending for _, ending, _ in _FILES}
    found = (one for one in folder.iterdir() if _without_packing(one) in endings)
    return sorted((one for one in found if one.is_file()), key=counting_order)


def _is_of_ros2(folder: Path) -> bool:
    """Return whether a folder's metadata are those of a bag of ROS 2."""
    if not (folder / _METADATA).is_file():
        return False
    with (folder / _METADATA).open("rb") as stream:
        return _INFORMATION.encode() in stream.read(_FIRST_BYTES)


def _without_packing(file: Path) -> str:
    """Return a name's ending, of ``a.db3.zstd`` that of what is packed."""
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
        missing = [one for one in names if not (place / one).is_file()]
        if missing:
            raise InputError(f"{missing[0]} is missing", file=place, expected=", ".join(names[:4]))
        return [place / one for one in names]
    if len(found) != 1:
        names = [one.name for one in found[:_LISTED]]
        raise InputError(
            f"holds {len(found)} files of messages and no {_METADATA} that says they are one",
            file=place,
            expected=f"one: {', '.join(names)}",
        )
    return found


def _ending(file: Path) -> str | None:
    """Return the ending that a file of messages has by its content, else by its name."""
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
    """Return the topic that is meant, and the model of its sensor where that was said."""
    count: Counter[Topic] = Counter()
    for file in files:
        for topic, messages in file.messages.items():
            count[topic] += len(messages)
    full = [topic for topic in sorted(count, key=lambda one: one.name) if count[topic]]
    clouds = [one for one in full if one.kind in CLOUDS]
    packets = [one for one in full if one.kind in PACKETS]
    if not clouds + packets:  # what else there may be is looked at
        of_ouster = [one for one in full if one.kind in OUSTER]
        packets = [one for one in of_ouster if is_of_lidar(_messages(files, one)[0])]

    def listed(topics: list[Topic]) -> str:
        told = [f"{one.name} ({one.kind or 'no type'}, {count[one]})" for one in topics[:_LISTED]]
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
    # Who recorded clouds and packets has the clouds of these packets.
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
    """Return a sentence on where the points' frame is, if the bag says it."""
    topics = {topic for file in files for topic in file.messages}
    told_of = [one for one in topics if one.kind == TRANSFORMS and is_static(one.name)]
    static = [one for topic in told_of for one in _messages(files, topic)][:_MOST_TRANSFORMS]
    if not static:
        return []
    try:
        cloud = cloud_message(first.topic, first.read(), first.file.path, str(first))
        with as_input_error(first.file.path, "transforms"):
            told = static_transforms(ros_message(one.topic, one.read()) for one in static)
    except InputError:  # said where that frame is read; transforms are beside the point
        return []
    found = place_of_frame(cloud.frame_id, told)
    return [] if found is None else [found]


def _names(times_ns: list[int]) -> tuple[str, ...]:
    """Return the frames' names: their times, numbered where several have one."""
    seen: Counter[int] = Counter()
    names = []
    for time in times_ns:
        names.append(str(time) if not seen[time] else f"{time}-{seen[time]}")
        seen[time] += 1
    return tuple(names)
