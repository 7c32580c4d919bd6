"""Packet captures: the sensor units that sent them, and the recording of a unit.

A packet's content determines its sensor: `velodyne_model`, `hesai_form`, or, for an Ouster, the
size in the metadata beside the capture. Names and ports are not used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.packets import (
    AXES,
    HEADER_BYTES,
    PART_LEFT_OUT,
    TWO_RETURNS,
    angles_of,
    firing_turns,
    hesai_fields,
    metadata_of,
    ouster_recording,
    turn_numbers,
    whole_turns,
)
from urbantwin.fidelity.readers.recording import Recording, file_and_choice
from urbantwin.io.packets.hesai import HesaiForm, hesai_form, unread_protocol
from urbantwin.io.packets.ouster import OusterFormat, read_ouster_format
from urbantwin.io.packets.pcap import Datagram, datagrams_in, is_pcap, mapped, payload_of
from urbantwin.io.packets.velodyne import TWO_RETURNS as TWO_OF_VELODYNE
from urbantwin.io.packets.velodyne import (
    Velodyne,
    azimuth_deg,
    unread_model,
    velodyne_model,
)

__all__ = ["CAPTURES", "is_capture_of", "open_capture"]

#: Layouts of captures, and their manufacturers.
CAPTURES = {"ouster": "an Ouster", "velodyne": "a Velodyne", "hesai": "a Hesai"}
_ENDINGS = (".pcap", ".pcapng", ".cap")
#: Datagrams read to detect the manufacturer.
_FIRST = 2000
#: Maximum number of units in an error message.
_LISTED = 6


@dataclass(eq=False)
class _Unit:
    """One sensor's packets in a capture."""

    layout: str
    models: tuple[str, ...]
    source: str
    port: int
    form: HesaiForm | OusterFormat | None = None
    packets: list[Datagram] = field(default_factory=list)

    @property
    def choice(self) -> str:
        return f"{self.source}:{self.port}"

    def __str__(self) -> str:
        return f"{self.choice} ({' or '.join(self.models)}, {len(self.packets)} packets)"


def is_capture_of(layout: str, path: Path) -> bool:
    """Return whether a path is a capture, or a folder with one, with packets of a layout.

    Packets of neither Velodyne nor Hesai are taken for an Ouster's.
    """
    found = _captures(file_and_choice(path)[0])
    return bool(found) and _layout_of(found[0]) == layout


def open_capture(path: Path, layout: str | None = None) -> Recording:
    """Open the packets of one unit, with one frame per rotation.

    Args:
        path: a capture, or a folder with one; after a colon, the unit's address, port, model, or
            several of these (``a.pcap:192.168.1.201:2368``).
        layout: one of ``CAPTURES``, to ignore other units.

    Raises:
        InputError: several captures or units, no known unit, or invalid metadata or angles.
    """
    place, choice = file_and_choice(path)
    captures = _captures(place)
    if len(captures) != 1:
        names = ", ".join(one.name for one in captures)
        raise InputError(f"holds {len(captures)} captures", file=path, expected=f"one: {names}")
    capture = captures[0]
    unit, model = _chosen(capture, _units(capture, layout), choice)
    if isinstance(unit.form, OusterFormat):
        return _ouster_recording(path, capture, unit.form, unit.packets)
    if isinstance(unit.form, HesaiForm):
        return _hesai_recording(path, capture, unit, model)
    return _velodyne_recording(path, capture, unit)


def _captures(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix.lower() in _ENDINGS or is_pcap(path) else []
    if not path.is_dir():
        return []
    return sorted(file for file in path.iterdir() if file.suffix.lower() in _ENDINGS)


def _layout_of(capture: Path) -> str:
    try:
        with mapped(capture) as data:
            for number, one in enumerate(datagrams_in(capture, data)):
                packet = _whole(data, one)
                if velodyne_model(packet) is not None:
                    return "velodyne"
                if hesai_form(packet) is not None:
                    return "hesai"
                if number > _FIRST:
                    break
    except InputError:  # reported when it is opened
        pass
    return "ouster"


def _whole(data: memoryview, one: Datagram) -> bytes:
    return b"".join(bytes(data[begin:end]) for begin, end in one.parts)


def _units(capture: Path, layout: str | None) -> list[_Unit]:
    """Return the units in a capture, with their packets in order."""
    units: dict[tuple[Any, ...], _Unit] = {}
    others: list[Datagram] = []
    unread: set[str | None] = set()
    with mapped(capture) as data:
        for one in datagrams_in(capture, data):
            packet = _whole(data, one)
            model = velodyne_model(packet)
            form = hesai_form(packet) if model is None else None
            if model is not None:
                key: tuple[Any, ...] = (model, one.source, one.port)
                new = _Unit("velodyne", (model,), one.source, one.port)
            elif form is not None:
                key = (form, one.source, one.port)
                new = _Unit("hesai", form.models, one.source, one.port, form)
            else:
                others.append(one)
                unread |= {unread_protocol(packet), unread_model(packet)} - {None}
                continue
            units.setdefault(key, new).packets.append(one)
    found = [one for one in units.values() if layout in (None, one.layout)]
    if layout in (None, "ouster"):
        found += _ousters(capture, others, unread, alone=not found)
    if not found:
        raise InputError(f"holds no packets of {CAPTURES[layout or 'ouster']}", file=capture)
    return found


def _ousters(
    capture: Path, packets: list[Datagram], unread: set[str | None], *, alone: bool
) -> list[_Unit]:
    """Return the Ouster units, by packets of the size in the metadata beside the capture.

    Args:
        capture: the file.
        packets: packets of no other manufacturer.
        unread: unsupported models of Hesai and Velodyne among them.
        alone: whether there are no other units; missing metadata are an error then.
    """
    if not packets and not alone:
        return []
    if unread and alone:
        raise InputError(
            f"holds packets of {', '.join(sorted(filter(None, unread)))}, which are not read",
            file=capture,
            expected="a model that docs/reference/formats.md names",
        )
    try:
        metadata = metadata_of(capture, "has no packets of a Velodyne or Hesai")
        form = read_ouster_format(metadata)
    except InputError:
        if alone:
            raise
        return []
    units: dict[tuple[str, int], _Unit] = {}
    for packet in packets:
        if packet.size == form.packet_size:
            new = _Unit("ouster", ("Ouster",), packet.source, packet.port, form)
            units.setdefault((packet.source, packet.port), new).packets.append(packet)
    if not units and alone:
        raise InputError(
            f"holds no packet of {form.packet_size} bytes, which {metadata.name} asks for, and "
            "none of a Velodyne or Hesai",
            file=capture,
            expected="the capture of this sensor",
        )
    return list(units.values())


def _chosen(capture: Path, units: list[_Unit], choice: str | None) -> tuple[_Unit, str | None]:
    """Return the chosen unit, and its model if the user named it."""
    said = [] if choice is None else [one for one in choice.split(":") if one]

    def names(unit: _Unit) -> set[str]:
        return {one.lower() for one in (unit.source, str(unit.port), *unit.models)}

    meant = [one for one in units if {part.lower() for part in said} <= names(one)]
    if len(meant) != 1:
        listed = ", ".join(map(str, sorted(units, key=lambda one: -len(one.packets))[:_LISTED]))
        told = f"holds packets of {len(units)} units" if meant else f"has no unit {choice}"
        raise InputError(
            told,
            file=capture,
            expected=f"one of {listed}, as {capture.name}:{units[0].choice}"
            + ("" if len({one.choice for one in units}) == len(units) else ":MODEL"),
        )
    unit = meant[0]
    of_said = (model for model in unit.models if model.lower() in {part.lower() for part in said})
    return unit, next(of_said, None)


def _payloads(capture: Path, packets: list[Datagram]) -> Iterator[bytes]:
    with capture.open("rb") as stream:
        for packet in packets:
            yield payload_of(stream, packet)


def _ouster_recording(
    path: Path, capture: Path, form: OusterFormat, packets: list[Datagram]
) -> Recording:
    def begun() -> Iterator[tuple[Datagram, bytes]]:
        with capture.open("rb") as stream:
            for packet in packets:
                begin, end = packet.parts[0]
                stream.seek(begin)
                yield packet, stream.read(min(end - begin, HEADER_BYTES))

    return ouster_recording(
        (path, capture, "ouster"), form, begun(), lambda some: list(_payloads(capture, some))
    )


def _velodyne_recording(path: Path, capture: Path, unit: _Unit) -> Recording:
    decoder = Velodyne(unit.models[0], capture, _payloads(capture, unit.packets))
    two, angles = False, []
    for packet in _payloads(capture, unit.packets):
        angles.append(azimuth_deg(packet))
        two = two or decoder.has_two_returns(packet)
    turn = turn_numbers(np.array(angles))
    begin = [0, *(1 + np.flatnonzero(np.diff(turn))).tolist(), len(turn)]
    first, last = whole_turns(np.diff(begin).tolist())
    notes = [*decoder.notes, *([TWO_OF_VELODYNE] if two else [])]

    def read(index: int) -> Frame:
        packets = unit.packets[begin[first + index] : begin[first + index + 1]]
        fields = decoder.fields(
            list(_payloads(capture, packets)), [packet.stamp_s for packet in packets]
        )
        return _frame(capture, first + index, fields)

    return _recording(path, "velodyne", (first, last, len(begin) - 1), read, notes)


def _hesai_recording(path: Path, capture: Path, unit: _Unit, model: str | None) -> Recording:
    form = unit.form
    assert isinstance(form, HesaiForm)
    sensor, notes = angles_of(unit.models, capture, model)
    turns = firing_turns(form, _payloads(capture, unit.packets))
    first, last = whole_turns([sum(stop - start for _, start, stop in one) for one in turns])
    said = [AXES, *notes]
    if form.returns_of(next(_payloads(capture, unit.packets))) > 1:
        said.append(TWO_RETURNS)

    def read(index: int) -> Frame:
        turn = turns[first + index]
        packets = [unit.packets[number] for number, *_ in turn]
        fields, notes = hesai_fields(
            form,
            sensor,
            list(_payloads(capture, packets)),
            [(start, stop) for _, start, stop in turn],
        )
        return _frame(capture, first + index, fields, notes)

    return _recording(path, "hesai", (first, last, len(turns)), read, said)


def _frame(capture: Path, number: int, fields: Any, notes: tuple[str, ...] = ()) -> Frame:  # noqa: ANN401
    known = {name: fields.pop(name) for name in ("intensity", "ring", "column", "time_s")
             if name in fields}  # fmt: skip
    return frame_of(capture, fields, name=str(number), given=known, notes=notes)


def _recording(
    path: Path,
    layout: str,
    turns: tuple[int, int, int],
    read: Callable[[int], Frame],
    notes: list[str],
) -> Recording:
    first, last, count = turns
    if last - first < count:
        notes = [*notes, PART_LEFT_OUT]
    names = tuple(str(number) for number in range(first, last))
    return Recording(path, layout, names, read, tuple(notes))
