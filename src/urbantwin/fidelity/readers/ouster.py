"""Recordings of Ouster sensors: a pcap file and the unit's metadata in JSON beside it."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import BinaryIO

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.ouster_packets import OusterFormat, read_ouster_format
from urbantwin.fidelity.readers.pcap import Datagram, datagrams_in
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["is_ouster", "open_ouster"]

#: A first or last scan with less than this share of its columns is left out.
_WHOLE = 0.95
_TWO_RETURNS = "Of two returns of a beam the first that the sensor reports is read."


def _captures(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix.lower() == ".pcap" else []
    return sorted(path.glob("*.pcap"))


def is_ouster(path: Path) -> bool:
    """Return whether a path is a pcap file, or a folder that holds one."""
    return bool(_captures(path))


def open_ouster(path: Path) -> Recording:
    """Open a capture; a frame is one turn of the sensor.

    Raises:
        InputError: there are several captures, no metadata beside it, no packet of this sensor,
            or the file is not a pcap.
    """
    captures = _captures(path)
    if len(captures) != 1:
        names = ", ".join(one.name for one in captures)
        raise InputError(f"holds {len(captures)} captures", file=path, expected=f"one: {names}")
    capture = captures[0]
    metadata = _metadata_of(capture)
    form = read_ouster_format(metadata)
    turns = _turns(capture, form)
    if not turns:
        raise InputError(
            f"holds no packet of {form.packet_size} bytes, which {metadata.name} asks for",
            file=capture,
            expected="the capture of this sensor",
        )
    kept = _whole_turns(turns)
    notes = [_TWO_RETURNS] if form.returns > 1 else []
    if len(kept) < len(turns):
        notes.append("A turn that the capture has only part of, first or last, is left out.")

    def read(index: int) -> Frame:
        frame, packets = kept[index]
        with capture.open("rb") as stream:
            scan = form.scan([_bytes(stream, one) for one in packets])
        row, column = np.nonzero(scan.range_m > 0)
        points = form.points(scan.range_m)[row, column]
        fields = dict(zip("xyz", points.T, strict=True))
        lost = form.columns - scan.columns
        return frame_of(
            capture,
            fields,
            name=str(frame),
            given={
                "intensity": scan.reflectivity[row, column],
                "ring": row,
                "column": column,
                "time_s": scan.time_s[column],
            },
            notes=(f"{lost} of {form.columns} columns are missing.",) if lost else (),
        )

    return Recording(path, "ouster", tuple(str(frame) for frame, _ in kept), read, tuple(notes))


def _metadata_of(capture: Path) -> Path:
    """Return the metadata of a capture: of the same name or its beginning, or the only one."""
    found = sorted(capture.parent.glob("*.json"))
    same = [one for one in found if capture.stem.startswith(one.stem)]
    chosen = sorted(same, key=lambda one: len(one.stem))[-1:] or found
    if len(chosen) != 1:
        problem = f"has {len(found)} JSON files beside it" if found else "has no JSON beside it"
        raise InputError(
            problem, file=capture, expected=f"the sensor's metadata as {capture.stem}.json"
        )
    return chosen[0]


def _turns(capture: Path, form: OusterFormat) -> list[tuple[int, list[Datagram]]]:
    """Return the packets of each turn in the order of the capture."""
    turns: list[tuple[int, list[Datagram]]] = []
    size = form.packet_size
    if not capture.stat().st_size:
        raise InputError("is empty", file=capture, expected="a pcap file")
    with (
        capture.open("rb") as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as mapped,
        memoryview(mapped) as data,
    ):
        for one in datagrams_in(capture, data):
            if sum(end - begin for begin, end in one) != size:
                continue  # of the inertial sensor, or of something else
            begin, end = one[0]
            frame = form.frame_id(bytes(data[begin : min(end, begin + 16)]))
            # Packets of two turns may change places, but not of three.
            for known, packets in turns[:-3:-1]:
                if known == frame:
                    packets.append(one)
                    break
            else:
                turns.append((frame, [one]))
    return turns


def _whole_turns(
    turns: list[tuple[int, list[Datagram]]],
) -> list[tuple[int, list[Datagram]]]:
    """Return the turns without a first or last one that was cut.

    A sensor that looks only one way sends fewer packets in every turn: whole is what most are.
    """
    most = max(len(packets) for _, packets in turns)
    first, last = 0, len(turns)
    if len(turns) > 1 and len(turns[0][1]) < _WHOLE * most:
        first = 1
    if last - first > 1 and len(turns[-1][1]) < _WHOLE * most:
        last -= 1
    return turns[first:last]


def _bytes(stream: BinaryIO, one: Datagram) -> bytes:
    parts = []
    for begin, end in one:
        stream.seek(begin)
        parts.append(stream.read(end - begin))
    return b"".join(parts)
