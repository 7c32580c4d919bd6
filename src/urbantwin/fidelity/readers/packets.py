"""Recordings of packets: rotations of a sensor, and frames of Hesai's and Ouster's sensors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.io.packets.hesai import HesaiForm
from urbantwin.io.packets.ouster import OusterFormat
from urbantwin.lidar.catalogue import load_sensor, sensor
from urbantwin.lidar.hesai import is_hesai_heading
from urbantwin.lidar.sensor import Sensor

__all__ = [
    "AXES",
    "HEADER_BYTES",
    "PART_LEFT_OUT",
    "TWO_RETURNS",
    "angles_of",
    "firing_turns",
    "hesai_fields",
    "metadata_of",
    "ouster_recording",
    "turn_numbers",
    "whole_turns",
]

#: Minimum size of a first or last rotation, as a share of the largest.
_WHOLE = 0.95
PART_LEFT_OUT = "A turn that the capture has only part of, first or last, is left out."
#: Maximum backward step of the angle within a rotation, degrees.
_BACK_DEG = 5.0


def turn_numbers(angle_deg: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the rotation of each firing, from 0; rotations start where the angle passes 0.

    A sensor may rotate in either direction, and may report a sector only.

    Args:
        angle_deg: (N,) angles in the order of firing, 0..360.
    """
    if not len(angle_deg):
        return np.zeros(0, np.int64)
    step = np.diff(angle_deg)
    short = (step + 180) % 360 - 180
    way = -1.0 if np.median(short) < 0 else 1.0
    forward = (way * step + _BACK_DEG) % 360 - _BACK_DEG
    start = way * angle_deg[0] % 360
    # Rounding of angles just before 0 must not start a rotation.
    along = start + np.concatenate([[0.0], np.cumsum(forward)]) + 1e-6
    turn = np.maximum.accumulate(np.floor(along / 360).astype(np.int64))
    return np.asarray(turn - turn[0], np.int64)


def whole_turns(sizes: Sequence[int]) -> tuple[int, int]:
    """Return the index of the first complete rotation, and the end index of the last.

    A sensor with a sector has smaller rotations: completeness is relative to the largest.

    Args:
        sizes: amount of data of each rotation.
    """
    most = max(sizes)
    first, last = 0, len(sizes)
    if len(sizes) > 1 and sizes[0] < _WHOLE * most:
        first = 1
    if last - first > 1 and sizes[-1] < _WHOLE * most:
        last -= 1
    return first, last


TWO_RETURNS = "Of two returns of a beam the first that the sensor reports is read."
AXES = "x is towards azimuth 0 and y to its left; Hesai's own programs have y there and x right."
#: Maximum number of lines, and of bytes, in which a CSV's header is searched.
_HEADING_LINES, _HEADING_BYTES = 5, 4096
#: Maximum duration of a frame, seconds; longer ones have invalid times.
_LONGEST_S = 5.0


def angles_of(
    models: Sequence[str], file: Path, chosen: str | None, *, choice: str | None = None
) -> tuple[Sensor, tuple[str, ...]]:
    """Return the unit's sensor, and notes on the source of its beam angles.

    Args:
        models: models that send such packets.
        file: the recording, beside which the unit's angle correction may be.
        chosen: one of the models, if the user named it.
        choice: the recording as given by the user; its name otherwise.

    Raises:
        InputError: the angle correction is invalid, or is missing though several models are
            possible.
    """
    if chosen is not None and chosen.lower() not in {model.lower() for model in models}:
        raise InputError(f"has no packets of a {chosen}", file=file, expected=" or ".join(models))
    correction = _correction_of(file)
    if correction is not None:
        found = load_sensor(correction, model=chosen or models[0])
        return found, (f"Angles of the beams are those of {correction.name}.",)
    if len(models) > 1 and chosen is None:
        raise InputError(
            f"has the packets of a {' or '.join(models)}, which are alike",
            file=file,
            expected=f"{choice or file.name}:{models[0]} to say which, or the unit's angle "
            f"correction beside it as {file.stem}.csv",
        )
    name = chosen or models[0]
    return sensor(name), (
        f"Angles of the beams are the catalogue's of the {name}: no angle correction of the unit "
        f"({file.stem}.csv) lies beside the recording.",
    )


def _correction_of(file: Path) -> Path | None:
    same = file.with_suffix(".csv")
    if same.is_file():
        return same
    found = [one for one in sorted(file.parent.glob("*.csv")) if _is_correction(one)]
    if len(found) > 1:
        raise InputError(
            f"has {len(found)} angle corrections beside it",
            file=file,
            expected=f"the unit's as {same.name}",
        )
    return found[0] if found else None


def _is_correction(path: Path) -> bool:
    with path.open("rb") as stream:
        lines = stream.read(_HEADING_BYTES).decode("utf-8-sig", "replace").splitlines()
    return any(is_hesai_heading(line.split(",")) for line in lines[:_HEADING_LINES])


def firing_turns(
    form: HesaiForm, packets: Iterator[bytes | memoryview]
) -> list[list[tuple[int, int, int]]]:
    """Return for each rotation its packets: number, first firing, and end of the firings.

    Args:
        form: layout of the packets.
        packets: packets of one unit, in order.
    """
    angles: list[float] = []
    ends: list[int] = []
    for packet in packets:
        angles += form.azimuth_deg(packet)[:: form.returns_of(packet)]
        ends.append(len(angles))
    turn = turn_numbers(np.array(angles))
    turns: list[list[tuple[int, int, int]]] = []
    begin, last = 0, -1
    for number, end in enumerate(ends):
        cuts = [begin, *(begin + 1 + np.flatnonzero(np.diff(turn[begin:end]))).tolist(), end]
        for first, behind in pairwise(cuts):
            if turn[first] != last:
                turns.append([])
                last = turn[first]
            turns[-1].append((number, first - begin, behind - begin))
        begin = end
    return turns


def hesai_fields(
    form: HesaiForm, unit: Sensor, packets: Sequence[bytes], which: Sequence[tuple[int, int]]
) -> tuple[dict[str, NDArray[np.generic]], tuple[str, ...]]:
    """Return the points of a rotation as fields, and notes about it.

    Args:
        form: layout of the packets.
        unit: sensor with beam directions and firing times.
        packets: packets of the rotation, in order.
        which: first firing and end of the firings of the rotation in each packet.
    """
    every = form.firings(packets)
    begin = np.cumsum([0] + [form.blocks // form.returns_of(packet) for packet in packets])
    kept = np.concatenate(
        [at + np.arange(*span) for at, span in zip(begin[:-1], which, strict=True)]
    )
    azimuth, ranges = every.azimuth_deg[kept], every.range_m[kept]
    intensity, time = every.intensity[kept], every.time_s[kept]
    firing, channel = np.nonzero(ranges > 0)
    elevation = np.radians(unit.elevation_deg)[channel]
    # the encoder's angle increases clockwise, ours counter-clockwise
    heading = np.radians(unit.azimuth_offset_deg[channel] - azimuth[firing])
    range_m = ranges[firing, channel]
    plan = range_m * np.cos(elevation)
    fields: dict[str, NDArray[np.generic]] = {
        "x": plan * np.cos(heading),
        "y": plan * np.sin(heading),
        "z": range_m * np.sin(elevation),
        "intensity": intensity[firing, channel],
        "ring": channel,
        "column": firing,
    }
    fired = np.zeros(form.lasers) if unit.firing_time_us is None else unit.firing_time_us * 1e-6
    times = time[firing] + fired[channel]
    if not len(times) or np.ptp(times) > _LONGEST_S:
        return fields, ("The sensor's clock jumps within the frame: its points have no time.",)
    return fields | {"time_s": times - times.min()}, ()


_TWO_RETURNS = "Of two returns of a beam the first that the sensor reports is read."
#: Number of a packet's first bytes that contain the frame number.
HEADER_BYTES = 16

Packet = TypeVar("Packet")


def ouster_recording(
    place: tuple[Path, Path, str],
    form: OusterFormat,
    packets: Iterable[tuple[Packet, bytes]],
    payloads: Callable[[list[Packet]], list[bytes]],
) -> Recording:
    """Return the recording of one unit, with one frame per rotation.

    Args:
        place: the path given by the user, the file, and the layout.
        form: format of the unit's packets.
        packets: the unit's packets, in order, each with its first bytes.
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
    """Return the metadata of a capture: with its name or a prefix of it, or the only one.

    Args:
        capture: the file.
        what: what is known about it, for errors.

    Raises:
        InputError: there are none, or several.
    """
    found = sorted(capture.parent.glob("*.json"))
    same = [item for item in found if capture.stem.startswith(item.stem)]
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
    """Return the packets of each rotation, in order."""
    turns: list[tuple[int, list[Packet]]] = []
    for one, start in packets:
        frame = form.frame_id(start)
        # Packets of adjacent rotations may be out of order.
        for known, some in turns[:-3:-1]:
            if known == frame:
                some.append(one)
                break
        else:
            turns.append((frame, [one]))
    return turns
