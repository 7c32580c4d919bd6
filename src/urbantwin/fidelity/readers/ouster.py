"""Captures of Ouster sensors: the turns of one, by its metadata in JSON beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.ouster_packets import OusterFormat
from urbantwin.fidelity.readers.pcap import Datagram, payload_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.turns import PART_LEFT_OUT, whole_turns

__all__ = ["metadata_of", "ouster_recording"]

_TWO_RETURNS = "Of two returns of a beam the first that the sensor reports is read."
#: A frame's number stands in so many of a packet's first bytes.
_HEADER_BYTES = 16


def ouster_recording(
    path: Path, capture: Path, form: OusterFormat, packets: list[Datagram]
) -> Recording:
    """Return the recording of one unit; a frame is one turn of the sensor.

    Args:
        path: as a person named it.
        capture: the file.
        form: of the unit's packets.
        packets: the unit's, in their order.
    """
    turns = _turns(capture, form, packets)
    first, last = whole_turns([len(some) for _, some in turns])
    kept = turns[first:last]
    notes = [_TWO_RETURNS] if form.returns > 1 else []
    if len(kept) < len(turns):
        notes.append(PART_LEFT_OUT)

    def read(index: int) -> Frame:
        frame, packets = kept[index]
        with capture.open("rb") as stream:
            scan = form.scan([payload_of(stream, one) for one in packets])
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


def metadata_of(capture: Path) -> Path:
    """Return the metadata of a capture: of the same name or its beginning, or the only one."""
    found = sorted(capture.parent.glob("*.json"))
    same = [one for one in found if capture.stem.startswith(one.stem)]
    chosen = sorted(same, key=lambda one: len(one.stem))[-1:] or found
    if len(chosen) != 1:
        problem = f"and {len(found)} JSON files beside it" if found else "and no JSON beside it"
        raise InputError(
            f"has no packets of a Velodyne or Hesai, {problem}",
            file=capture,
            expected=f"an Ouster's metadata as {capture.stem}.json",
        )
    return chosen[0]


def _turns(
    capture: Path, form: OusterFormat, packets: list[Datagram]
) -> list[tuple[int, list[Datagram]]]:
    """Return the packets of each turn in the order of the capture."""
    turns: list[tuple[int, list[Datagram]]] = []
    with capture.open("rb") as stream:
        for one in packets:
            begin, end = one.parts[0]
            stream.seek(begin)
            frame = form.frame_id(stream.read(min(end - begin, _HEADER_BYTES)))
            # Packets of two turns may change places, but not of three.
            for known, some in turns[:-3:-1]:
                if known == frame:
                    some.append(one)
                    break
            else:
                turns.append((frame, [one]))
    return turns
