"""Parameters of drivers, each with the statistic of traffic that it is fitted by."""

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

#: Headway of vehicles leaving a queue.
QUEUES = "queue_headway_s"
#: Least number of values of a statistic.
FEWEST_VALUES = 5
#: Least number if another statistic exists for the same parameter.
_MIN_OF_ALTERNATIVE = 10
#: Least number of speeds, since many of those vehicles still accelerate.
_MIN_FREE_SPEEDS = 30
#: Longest headway of a following vehicle at a stop line, seconds.
_MAX_FOLLOWING_S = 4.0


@dataclass(frozen=True)
class Parameter:
    """A field of ``traffic.drivers`` and the statistic that it is fitted by.

    Attributes:
        field: its name.
        usual: start of the search.
        least: smallest value.
        most: largest value.
        sample: returns the values of a measurement that the statistic is computed from.
        figure: the statistic: median, ...
        ratio: whether parameter and statistic are proportional (else: they differ by a constant).
        what: description of the values.
        fewest: least number of values; of several parameters of one field the first with enough
            values is used.
        classes: classes that it applies to; empty: all motor traffic without an own one.
        where: attribute of the measurement with values by place that the sample joins; empty: none.
        there: attribute of the sample, if it differs from ``where`` but has the same places.
        approach: road of the queue that it applies to; empty: any without an own one.
        gain: change of the parameter per unit of the statistic (for ratios: of their logarithms).
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
        """The field with its classes and approach."""
        class_words = ["of", *self.classes] if self.classes else []
        return " ".join(
            [self.field, *class_words, *(["on", self.approach] if self.approach else [])]
        )


def _robust_deviation(values: list[float]) -> float:
    """Return a robust standard deviation, from the quartiles."""
    low, high = np.quantile(values, [0.25, 0.75])
    return float(high - low) / 1.349


def _median(values: list[float]) -> float:
    return float(np.median(values))


def _lower_third(values: list[float]) -> float:
    """Return the lower third's quantile: longer headways are not chosen by the driver."""
    return float(np.quantile(values, 1 / 3))


def _upper_quartile(values: list[float]) -> float:
    """Return the upper quartile: curves and other traffic slow some drivers down."""
    return float(np.quantile(values, 0.75))


PARAMETERS = (
    Parameter(
        *("speed_factor", 1.0, 0.4, 1.5),
        lambda part: part.all_free,
        *(
            _median,
            True,
            "speeds of who leaves with nobody close ahead, of the limit",
            _MIN_FREE_SPEEDS,
        ),
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
        *(_robust_deviation, True, "spreads of such speeds", _MIN_FREE_SPEEDS),
        where="free",
    ),
    Parameter(
        *("acceleration", 2.6, 0.8, 4.5),
        lambda part: part.leading,
        *(
            _upper_quartile,
            True,
            "accelerations from 1 to 5 m/s of the first of queues, m/s2",
            _MIN_OF_ALTERNATIVE,
        ),
    ),
    Parameter(
        *("acceleration", 2.6, 0.8, 4.5),
        lambda part: part.accelerations,
        *(_median, True, "accelerations from 1 to 5 m/s, m/s2"),
    ),
    Parameter(
        *("acceleration", 2.6, 0.4, 4.5),
        lambda part: part.heavy_accelerations,
        *(_median, True, "accelerations from 1 to 5 m/s, m/s2", _MIN_OF_ALTERNATIVE),
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
        *(_median, True, "accelerations from 6 to 9 m/s, m/s2", _MIN_OF_ALTERNATIVE),
        classes=HEAVY,
    ),
    Parameter(
        *("sideways_acceleration", SIDEWAYS_MS2, 1.0, 30.0),
        lambda part: [
            speed for _, of_movement in sorted(part.turning.items()) for speed in of_movement
        ],
        *(_median, True, "speeds in turns, m/s"),
        where="bends",
        there="turning",
        gain=2.0,  # proportional to the square of the speed
    ),
    Parameter(
        *("standing_gap_m", 2.0, 0.5, 6.0),
        lambda part: part.gaps,
        *(_median, False, "gaps of who stands behind each other, m"),
    ),
    Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.driving,
        *(
            _lower_third,
            False,
            "times from bumper to bumper of who follows and has not stood, s",
            _MIN_FREE_SPEEDS,
        ),
    ),
    Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.following,
        *(
            _lower_third,
            False,
            "times from bumper to bumper of who follows, s",
            _MIN_OF_ALTERNATIVE,
        ),
    ),
    Parameter(
        *(QUEUES, 1.35, 0.5, 4.0),
        lambda part: part.all_discharge,
        *(
            _median,
            False,
            "times between who leaves a queue at the stop line, s",
            _MIN_OF_ALTERNATIVE,
        ),
        gain=2.0,  # a starting vehicle at the stop line has not reached its final headway
    ),
    Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.all_headways[part.all_headways <= _MAX_FOLLOWING_S].tolist(),
        *(_median, False, "headways of who follows at the stop line, s"),
    ),
    Parameter(
        *("critical_gap_s", 1.0, 0.1, 8.0),
        lambda part: part.gap_choices if any(gap > 0 for gap, _ in part.gap_choices) else [],
        *(critical_gap, False, "choices of a gap by who gives way, s", _MIN_OF_ALTERNATIVE),
    ),
)


def where_it_shows(one: Parameter, recorded: Measured) -> Parameter:
    """Return a statistic restricted to the turn or exit with the largest values.

    Only those with at least ten values (speeds: thirty) are considered. Elsewhere curves, limits,
    signals or yielding limit drivers, so that values say nothing about their wishes; deviations of
    the simulation there would distort drivers everywhere.
    """
    places: dict[Any, list[float]] = getattr(recorded, one.where) if one.where else {}
    medians = {
        place: _median(x)
        for place, x in places.items()
        if len(x) >= max(one.fewest, _MIN_OF_ALTERNATIVE)
    }
    if not medians:
        return one
    place = max(sorted(medians), key=medians.__getitem__)
    return replace(one, sample=lambda part: getattr(part, one.there or one.where).get(place, []))


def by_approach(recorded: Measured) -> list[Parameter]:
    """Return the queue headways by approach, for approaches with many values."""
    if len(recorded.discharge) < 2:
        return []

    def discharge(approach: str) -> Callable[[Measured], list[Any]]:
        return lambda part: part.discharge.get(approach, [])

    (queue_parameter,) = (parameter for parameter in PARAMETERS if parameter.name == QUEUES)
    return [
        replace(queue_parameter, sample=discharge(name), approach=name)
        for name, values in sorted(recorded.discharge.items())
        if len(values) >= FEWEST
    ]


def elsewhere(apart: Collection[Parameter]) -> Parameter:
    """Return the queue headway of all approaches without one of their own."""
    names = {parameter.approach for parameter in apart}
    (queue_parameter,) = (parameter for parameter in PARAMETERS if parameter.name == QUEUES)
    return replace(
        queue_parameter,
        sample=lambda part: [
            value
            for name, values in sorted(part.discharge.items())
            if name not in names
            for value in values
        ],
    )
