"""Parameters of drivers, and the figure of traffic that tells each of them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urbantwin.roads.curve_speed import SIDEWAYS_MS2
from urbantwin.traffic.calibration.gap_acceptance import critical_gap
from urbantwin.traffic.calibration.lane_use import FEWEST
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import HEAVY

__all__ = [
    "FEWEST_VALUES",
    "PARAMETERS",
    "QUEUES",
    "Parameter",
    "by_approach",
    "elsewhere",
    "where_it_shows",
]

#: The headway of those who have stood.
QUEUES = "queue_headway_s"
#: Figures of fewer values than this tell nothing.
FEWEST_VALUES = 5
#: Where there is another figure for the same, of fewer than this.
_MANY = 10
#: Speeds of fewer, many of whom still speed up, tell no wish.
_FREE = 30
#: At a stop line, who comes so soon after another follows, seconds.
_FOLLOWS_S = 4.0


@dataclass(frozen=True)
class Parameter:
    """A field of ``traffic.drivers`` and the figure that tells it.

    Attributes:
        field: its name.
        usual: where the search begins.
        least: smallest value.
        most: largest value.
        sample: of what was measured, the values that are summed up.
        figure: a sum of them: median, ...
        ratio: whether the parameter goes as the figure (else: by as much).
        what: the values in words.
        fewest: with fewer values it is not fitted; of several parameters of one field the first
            with enough values is.
        classes: of these alone; empty: of all motor traffic that has none of its own.
        where: what was measured, place by place, of which the sample is all; empty: not so.
        there: what the sample is of, where that is something else measured at the same places.
        approach: of those who stood on this road alone; empty: on any that has none of its own.
        gain: how far the parameter moves for a figure that is off by one (of ratios: by one
            of their logarithm).
    """

    field: str
    usual: float
    least: float
    most: float
    sample: Callable[[Measured], list[Any]]
    figure: Callable[[list[Any]], float]
    ratio: bool
    what: str
    fewest: int = FEWEST_VALUES
    classes: tuple[str, ...] = ()
    where: str = ""
    there: str = ""
    approach: str = ""
    gain: float = 1.0

    @property
    def name(self) -> str:
        """The field, whose it is, and where."""
        whose = ["of", *self.classes] if self.classes else []
        return " ".join([self.field, *whose, *(["on", self.approach] if self.approach else [])])


def _quartiles_apart(values: list[float]) -> float:
    """Return a standard deviation that outliers do not move: of the quartiles."""
    low, high = np.quantile(values, [0.25, 0.75])
    return float(high - low) / 1.349


def _median(values: list[float]) -> float:
    return float(np.median(values))


def _near(values: list[float]) -> float:
    """Return the value that a third is below: the others have more room than they want."""
    return float(np.quantile(values, 1 / 3))


def _quicker(values: list[float]) -> float:
    """Return the value that three quarters are below: bends and others hold some of them up."""
    return float(np.quantile(values, 0.75))


PARAMETERS = (
    Parameter(
        *("speed_factor", 1.0, 0.4, 1.5),
        lambda part: part.all_free,
        *(_median, True, "speeds of who leaves with nobody close ahead, of the limit", _FREE),
        where="free",
    ),
    Parameter(
        *("speed_factor", 1.0, 0.4, 1.5),
        lambda part: sorted(part.tops)[len(part.tops) // 2 :],
        *(_median, True, "best speeds of the quicker half, as shares of the limit"),
    ),
    Parameter(
        *("speed_spread", 0.1, 0.01, 0.3),
        lambda part: part.all_free,
        *(_quartiles_apart, True, "spreads of such speeds", _FREE),
        where="free",
    ),
    Parameter(
        *("acceleration", 2.6, 0.8, 4.5),
        lambda part: part.leading,
        *(_quicker, True, "accelerations from 1 to 5 m/s of the first of queues, m/s2", _MANY),
    ),
    Parameter(
        *("acceleration", 2.6, 0.8, 4.5),
        lambda part: part.accelerations,
        *(_median, True, "accelerations from 1 to 5 m/s, m/s2"),
    ),
    Parameter(
        *("acceleration", 2.6, 0.4, 4.5),
        lambda part: part.heavy_accelerations,
        *(_median, True, "accelerations from 1 to 5 m/s, m/s2", _MANY),
        classes=HEAVY,
    ),
    Parameter(
        *("acceleration_at_10", 2.6, 0.3, 4.5),
        lambda part: part.faded,
        *(_median, True, "accelerations from 6 to 9 m/s, m/s2"),
    ),
    Parameter(
        *("acceleration_at_10", 2.6, 0.3, 4.5),
        lambda part: part.heavy_faded,
        *(_median, True, "accelerations from 6 to 9 m/s, m/s2", _MANY),
        classes=HEAVY,
    ),
    Parameter(
        *("sideways_acceleration", SIDEWAYS_MS2, 1.0, 30.0),
        lambda part: [one for _, found in sorted(part.turning.items()) for one in found],
        *(_median, True, "speeds in turns, m/s"),
        where="bends",
        there="turning",
        gain=2.0,  # it goes as the square of the speed
    ),
    Parameter(
        *("standing_gap_m", 2.0, 0.5, 6.0),
        lambda part: part.gaps,
        *(_median, False, "gaps of who stands behind each other, m"),
    ),
    Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.driving,
        *(_near, False, "times from bumper to bumper of who follows and has not stood, s", _FREE),
    ),
    Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.following,
        *(_near, False, "times from bumper to bumper of who follows, s", _MANY),
    ),
    Parameter(
        *(QUEUES, 1.35, 0.5, 4.0),
        lambda part: part.all_discharge,
        *(_median, False, "times between who leaves a queue at the stop line, s", _MANY),
        gain=2.0,  # who sets out at the stop line does not yet drive as it would in the end
    ),
    Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.all_headways[part.all_headways <= _FOLLOWS_S].tolist(),
        *(_median, False, "headways of who follows at the stop line, s"),
    ),
    Parameter(
        *("critical_gap_s", 1.0, 0.1, 8.0),
        lambda part: part.gap_choices if any(gap > 0 for gap, _ in part.gap_choices) else [],
        *(critical_gap, False, "choices of a gap by who gives way, s", _MANY),
    ),
)


def where_it_shows(one: Parameter, recorded: Measured) -> Parameter:
    """Return a figure of turns or exits as that of the one on which values are largest.

    Of those that ten values tell (of speeds, thirty). On others bends, limits, signals or giving
    way hold drivers up: they tell nothing of what these would do, and a simulation that is held up
    there otherwise would be answered by other drivers everywhere.
    """
    places: dict[Any, list[float]] = getattr(recorded, one.where) if one.where else {}
    told = {at: _median(x) for at, x in places.items() if len(x) >= max(one.fewest, _MANY)}
    if not told:
        return one
    place = max(sorted(told), key=told.__getitem__)
    return replace(one, sample=lambda part: getattr(part, one.there or one.where).get(place, []))


def by_approach(recorded: Measured) -> list[Parameter]:
    """Return the headways of queues, approach by approach, where many left one on several."""
    if len(recorded.discharge) < 2:
        return []

    def discharge(approach: str) -> Callable[[Measured], list[Any]]:
        return lambda part: part.discharge.get(approach, [])

    (every,) = (one for one in PARAMETERS if one.name == QUEUES)
    return [
        replace(every, sample=discharge(name), approach=name)
        for name, values in sorted(recorded.discharge.items())
        if len(values) >= FEWEST
    ]


def elsewhere(apart: Collection[Parameter]) -> Parameter:
    """Return the headway of queues on all approaches but those that have one of their own."""
    names = {one.approach for one in apart}
    (every,) = (one for one in PARAMETERS if one.name == QUEUES)
    return replace(
        every,
        sample=lambda part: [
            value
            for name, values in sorted(part.discharge.items())
            if name not in names
            for value in values
        ],
    )
