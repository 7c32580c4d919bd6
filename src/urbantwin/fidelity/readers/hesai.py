"""Captures of Hesai's sensors: their turns, and the points of one, by the unit's angles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.readers.hesai_packets import HesaiForm
from urbantwin.fidelity.readers.turns import turn_numbers
from urbantwin.lidar.catalogue import load_sensor, sensor
from urbantwin.lidar.hesai import is_hesai_heading
from urbantwin.lidar.sensor import Sensor

__all__ = ["AXES", "TWO_RETURNS", "angles_of", "firing_turns", "hesai_fields"]

TWO_RETURNS = "Of two returns of a beam the first that the sensor reports is read."
AXES = "x is towards azimuth 0 and y to its left; Hesai's own programs have y there and x right."
#: A CSV's heading stands among its first lines, which have no more bytes than this.
_HEADING_LINES, _HEADING_BYTES = 5, 4096
#: No frame lasts longer, seconds: what does is no time.
_LONGEST_S = 5.0


def angles_of(
    models: Sequence[str], file: Path, chosen: str | None, *, choice: str | None = None
) -> tuple[Sensor, tuple[str, ...]]:
    """Return the unit's sensor, and what a reader of figures must know about its angles.

    Args:
        models: whose packets these are like.
        file: the recording, beside which the unit's angle correction may lie.
        chosen: one of the models, if a person said which.
        choice: what a person names the recording by; its name where nothing was chosen.

    Raises:
        InputError: the angle correction is not right, or is missing though packets are those of
            several models.
    """
    if chosen is not None and chosen.lower() not in {one.lower() for one in models}:
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
    """Return for each turn the packets in it: number, its first firing and the one behind its last.

    Args:
        form: of the packets.
        packets: of one unit in their order.
    """
    angles: list[float] = []
    ends: list[int] = []
    for one in packets:
        angles += form.azimuth_deg(one)[:: form.returns_of(one)]
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
    """Return the points of a turn with what is known of each, and notes on it.

    Args:
        form: of the packets.
        unit: where its beams point, and when they fire.
        packets: of the turn, in their order.
        which: of each packet, its first firing in the turn and the one behind its last.
    """
    every = form.firings(packets)
    begin = np.cumsum([0] + [form.blocks // form.returns_of(one) for one in packets])
    kept = np.concatenate(
        [at + np.arange(*span) for at, span in zip(begin[:-1], which, strict=True)]
    )
    azimuth, ranges = every.azimuth_deg[kept], every.range_m[kept]
    intensity, time = every.intensity[kept], every.time_s[kept]
    firing, channel = np.nonzero(ranges > 0)
    elevation = np.radians(unit.elevation_deg)[channel]
    # The encoder's angle grows clockwise, ours counter-clockwise.
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
