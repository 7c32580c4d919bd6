"""Effect of the time of day: the quarters of an hour of counts, and the size of guesses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from urbantwin.errors import InputError
from urbantwin.traffic.demand.count_rates import QUARTER_S

__all__ = ["CARS", "TRUCKS", "at_time_of_day", "counts_from", "hour_factor"]

#: Percentages of the traffic of a Tuesday to Thursday in each hour, streets at the border of inner
#: cities: G. Schmidt, B. Thomas, Hochrechnungsfaktoren für manuelle und automatische
#: Kurzzeitzählungen im Innerortsbereich (BMV, Forschung Straßenbau und Straßenverkehrstechnik 732,
#: 1996), cars p. 95, trucks p. 98; as SUMO's documentation quotes them (Importing O/D Matrices,
#: TGw2_PKW and TGw_LKW). Classes without a curve of their own use that of cars.
_CARS_NIGHT, _CARS_DAY = (0.8, 0.5, 0.4, 0.3, 0.4, 1.2), (4.5, 7.4, 6.6, 5.2, 5.0, 5.0)
_CARS_NOON, _CARS_EVENING = (5.2, 5.3, 5.6, 6.7, 8.4, 8.6), (7.4, 5.0, 3.9, 3.0, 2.1, 1.6)
CARS: tuple[float, ...] = (*_CARS_NIGHT, *_CARS_DAY, *_CARS_NOON, *_CARS_EVENING)
_TRUCKS_NIGHT, _TRUCKS_DAY = (0.3, 0.4, 0.4, 0.6, 0.8, 2.0), (4.8, 7.5, 9.0, 8.7, 9.0, 9.0)
_TRUCKS_NOON, _TRUCKS_EVENING = (7.5, 8.4, 7.8, 6.9, 5.4, 4.0), (2.7, 1.8, 1.2, 0.9, 0.6, 0.3)
TRUCKS: tuple[float, ...] = (*_TRUCKS_NIGHT, *_TRUCKS_DAY, *_TRUCKS_NOON, *_TRUCKS_EVENING)
#: Hours that guesses refer to.
_GUESSED_HOURS = slice(10, 15)


def at_time_of_day(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return a site's ``traffic`` at its time of day, with the field ``time_of_day`` cleared.

    Raises:
        InputError: counts end before this time, or begin later.
    """
    settings = dict(asked)
    time = asked.get("time_of_day")
    if not time:
        return settings
    settings["time_of_day"] = None
    settings["counts"] = counts_from(asked.get("counts", ()), time)
    if asked.get("guessed"):
        settings["per_hour"] = {
            name: n * hour_factor(time, name) for name, n in asked["per_hour"].items()
        }
    return settings


def hour_factor(time: str, actor_class: str = "car") -> float:
    """Return the traffic of a class at a time (``08:00``) relative to midday."""
    day = TRUCKS if actor_class == "truck" else CARS
    midday = day[_GUESSED_HOURS]
    return day[int(time[:2])] * len(midday) / sum(midday)


def counts_from(counts: Sequence[Mapping[str, Any]], time: str) -> list[dict[str, Any]]:
    """Return counts from the quarter of an hour of a time (``08:00``) on.

    Raises:
        InputError: there are none at that time.
    """
    rows = []
    for number, row in enumerate(counts):
        changed = dict(row)
        if row.get("begin") and row.get("per_quarter"):
            skipped = (_minutes(time) - _minutes(row["begin"])) * 60 // QUARTER_S
            if not 0 <= skipped < len(row["per_quarter"]):
                last = _minutes(row["begin"]) + 15 * len(row["per_quarter"])
                raise InputError(
                    f"was not counted at {time}",
                    place=row.get("row") or f"traffic.counts[{number}]",
                    expected=f"a time from {row['begin']} to {last // 60:02}:{last % 60:02}",
                )
            changed["per_quarter"] = list(row["per_quarter"])[int(skipped) :]
            changed["begin"] = time
        rows.append(changed)
    return rows


def _minutes(time: str) -> int:
    return 60 * int(time[:2]) + int(time[3:])
