"""What a time of day changes: the quarters of an hour of counts, and the size of guesses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from urbantwin.errors import InputError
from urbantwin.traffic.demand.counted_volumes import QUARTER_S

__all__ = ["at_time_of_day", "counts_from", "hour_factor"]

#: Share of a weekday's traffic in each hour on urban streets (US EPA, Population and Activity of
#: On-road Vehicles in MOVES2014, EPA-420-R-16-003a, 2016: default hourVMTFraction).
_NIGHT = (0.00986, 0.00627, 0.00506, 0.00467, 0.00699, 0.01849, 0.04596, 0.06964)
_DAY = (0.06083, 0.05029, 0.04994, 0.05437, 0.05765, 0.05803, 0.06226, 0.07100)
_EVENING = (0.07697, 0.07743, 0.05978, 0.04439, 0.03545, 0.03182, 0.02494, 0.01791)
HOURS = (*_NIGHT, *_DAY, *_EVENING)
#: Guesses are those of these hours.
MIDDAY = HOURS[10:15]


def at_time_of_day(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``traffic`` of a site as it is at its time of day, which then is named no more.

    Raises:
        InputError: counts do not last until then, or begin later.
    """
    found = dict(asked)
    time = asked.get("time_of_day")
    if not time:
        return found
    found["time_of_day"] = None
    found["counts"] = counts_from(asked.get("counts", ()), time)
    if asked.get("guessed"):
        factor = hour_factor(time)
        found["per_hour"] = {name: n * factor for name, n in asked["per_hour"].items()}
    return found


def hour_factor(time: str) -> float:
    """Return how much traffic there is at a time (``08:00``) against midday."""
    return HOURS[int(time[:2])] * len(MIDDAY) / sum(MIDDAY)


def counts_from(counts: Sequence[Mapping[str, Any]], time: str) -> list[dict[str, Any]]:
    """Return counts from the quarter of an hour of a time (``08:00``) on.

    Raises:
        InputError: there are none at that time.
    """
    found = []
    for number, row in enumerate(counts):
        one = dict(row)
        if row.get("begin") and row.get("per_quarter"):
            skipped = (_minutes(time) - _minutes(row["begin"])) * 60 // QUARTER_S
            if not 0 <= skipped < len(row["per_quarter"]):
                last = _minutes(row["begin"]) + 15 * len(row["per_quarter"])
                raise InputError(
                    f"was not counted at {time}",
                    place=row.get("row") or f"traffic.counts[{number}]",
                    expected=f"a time from {row['begin']} to {last // 60:02}:{last % 60:02}",
                )
            one["per_quarter"] = list(row["per_quarter"])[int(skipped) :]
            one["begin"] = time
        found.append(one)
    return found


def _minutes(time: str) -> int:
    return 60 * int(time[:2]) + int(time[3:])
