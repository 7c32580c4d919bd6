"""Ouster sensors: the turns in the packets of one, and the unit's metadata beside a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.ouster_packets import OusterFormat
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.turns import PART_LEFT_OUT, whole_turns

__all__ = ["HEADER_BYTES", "metadata_of", "ouster_recording"]

_TWO_RETURNS = "Of two returns of a beam the first that the sensor reports is read."
#: A frame's number stands in so many of a packet's first bytes.
HEADER_BYTES = 16

Packet = TypeVar("Packet")


def ouster_recording(
    place: tuple[Path, Path, str],
    form: OusterFormat,
    packets: Iterable[tuple[Packet, bytes]],
    payloads: Callable[[list[Packet]], list[bytes]],
) -> Recording:
    """Return the recording of one unit; a frame is one turn of the sensor.

    Args:
        place: the recording as a person named it, its file, and its layout.
        form: of the unit's packets.
        packets: the unit's, in their order, each with its first bytes.
        payloads: reads packets.
    """
    path, file, layout = place
    turns = _turns(form, packets)
    first, last = whole_turns([len(some) for _, some in turns])
    kept = turns[first:last]
    notes = [_TWO_RETURNS] if form.returns > 1 else []
    if len(kept) < len(turns):
        notes.append(PART_LEFT_OUT)

    def read(index: int) -> Frame:
        frame, some = kept[index]
        scan = form.scan(payloads(some))
        row, column = np.nonzero(scan.range_m > 0)
        points = form.points(scan.range_m)[row, column]
        fields = dict(zip("xyz", points.T, strict=True))
        lost = form.columns - scan.columns
        return frame_of(
            file,
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

    return Recording(path, layout, tuple(str(frame) for frame, _ in kept), read, tuple(notes))


def metadata_of(capture: Path, what: str) -> Path:
    """Return the metadata of a capture: of the same name or its beginning, or the only one.

    Args:
        capture: the file.
        what: is known of it, for errors.

    Raises:
        InputError: there are none, or several.
    """
    found = sorted(capture.parent.glob("*.json"))
    same = [one for one in found if capture.stem.startswith(one.stem)]
    chosen = sorted(same, key=lambda one: len(one.stem))[-1:] or found
    if len(chosen) != 1:
        problem = f"and {len(found)} JSON files beside it" if found else "and no JSON beside it"
        raise InputError(
            f"{what}, {problem}",
            file=capture,
            expected=f"an Ouster's metadata as {capture.stem}.json",
        )
    return chosen[0]


def _turns(
    form: OusterFormat, packets: Iterable[tuple[Packet, bytes]]
) -> list[tuple[int, list[Packet]]]:
    """Return the packets of each turn in their order."""
    turns: list[tuple[int, list[Packet]]] = []
    for one, start in packets:
        frame = form.frame_id(start)
        # Packets of two turns may change places, but not of three.
        for known, some in turns[:-3:-1]:
            if known == frame:
                some.append(one)
                break
        else:
            turns.append((frame, [one]))
    return turns
