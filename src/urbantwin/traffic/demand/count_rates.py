"""Rates of counted traffic by class and quarter of an hour, and random departures for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["QUARTER_S", "departures_of", "is_counted", "rates_of", "wanted_of"]

QUARTER_S = 900.0
_NOT_MOTORS = ("bicycle", "pedestrian", "tram")


def is_counted(actor_class: str, counts: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether counts determine the number of actors of a class."""
    named = {
        row.get("actor_class") or ("pedestrian" if row.get("crossing") else None) for row in counts
    }
    return actor_class in named or (None in named and actor_class not in _NOT_MOTORS)


def rates_of(
    row: Mapping[str, Any], per_hour: Mapping[str, float], place: str
) -> dict[str, list[float]]:
    """Return, by class, the actors per hour in each quarter of an hour; a single value is constant.

    Args:
        row: row of ``traffic.counts``.
        per_hour: composition of motor traffic that is counted without a class.
        place: place of the row in its document, for errors.

    Raises:
        InputError: the class cannot be counted at such a place.
    """
    if row.get("per_quarter"):
        rates = [4.0 * float(count) for count in row["per_quarter"]]
    else:
        rates = [float(row["per_hour"])]
    if row.get("crossing") and not row.get("actor_class"):
        return {"pedestrian": rates}
    if row.get("actor_class"):
        drive = set(ACTOR_CLASSES) - {"pedestrian"}
        if row["actor_class"] not in (("pedestrian", "bicycle") if row.get("crossing") else drive):
            raise InputError(
                f"counts a {row['actor_class']}",
                place=place,
                expected="pedestrians and bicycles at a crossing, other classes by approach and "
                "turn or on a road",
            )
        return {row["actor_class"]: rates}
    motors = {name: rate for name, rate in per_hour.items() if name not in _NOT_MOTORS and rate > 0}
    motors = motors or {"car": 1.0}
    whole = sum(motors.values())
    return {name: [rate * share / whole for rate in rates] for name, share in motors.items()}


def wanted_of(
    rates: Sequence[float], warmup_s: float, duration_s: float
) -> list[tuple[float, float, float]]:
    """Return (begin, end, number of actors); times in seconds from the start of the warm-up."""
    intervals, end = [], warmup_s + duration_s
    begin = 0.0
    for number, rate in enumerate(rates):
        last = number == len(rates) - 1
        until = end if last else min(warmup_s + (number + 1) * QUARTER_S, end)
        if until > begin:
            intervals.append((begin, until, rate * (until - begin) / 3600.0))
            begin = until
    return intervals


def departures_of(
    wanted: Sequence[tuple[float, float, float]],
    owed: float,
    random: np.random.Generator,
    *,
    evenly: bool = True,
) -> NDArray[np.float64]:
    """Return random times of departure for the requested numbers, seconds.

    Args:
        wanted: (begin, end, number of actors).
        owed: fraction of a vehicle carried over from earlier rows, so that fractions add up.
        random: random generator.
        evenly: stratified, one in each of as many equal parts as there are departures; else
            independent of each other.
    """
    times = []
    for begin, end, count in wanted:
        whole = int(np.floor(owed + count))
        owed = owed + count - whole
        drawn = random.random(whole)
        share = (np.arange(whole) + drawn) / max(whole, 1) if evenly else np.sort(drawn)
        times.append(begin + share * (end - begin))
    return np.concatenate(times) if times else np.zeros(0)
