"""How drivers drive: parameters for which a simulation shows what was recorded.

Indirect inference (Gourieroux, Monfort and Renault, Journal of Applied Econometrics 8, 1993): each
parameter has a figure of the traffic that moves with it. The same figure is taken of the recording
and of a simulation; the parameter is moved by the difference, and simulated again. What queues,
signals and the way of measuring do to the figure, they do on both sides.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urbantwin.roads.curve_speed import SIDEWAYS_MS2
from urbantwin.traffic.calibration.agreement import agreement
from urbantwin.traffic.calibration.gap_acceptance import critical_gap
from urbantwin.traffic.calibration.lane_use import FEWEST, shrunk
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import HEAVY, MOTORS

__all__ = ["ROUNDS", "fitted_drivers", "of_approaches", "of_classes"]

#: Simulations.
ROUNDS = 6
_QUEUES = "queue_headway_s"
#: Figures of fewer than this tell nothing.
_FEWEST = 5
#: A parameter moves half as far if so few values are simulated; and a figure that is not simulated
#: is so many times as far off as the recording tells it.
_FEW, _NONE_SHOWN = 5, 20.0
#: Distributions are to be as near as this (Kolmogorov-Smirnov).
_WANTED_KS = 0.1
#: Where there is another figure for the same, of fewer than this.
_MANY = 10
#: Speeds of fewer, many of whom still speed up, tell no wish.
_FREE = 30
_DRAWN_AGAIN = 200
#: A figure that differs by no more is the same.
_SAME = 0.02
#: At a stop line, who comes so soon after another follows, seconds.
_FOLLOWS_S = 4.0
#: A parameter moves by so much of the difference, less from round to round.
_STEPS = (1.0, 1.0, 0.8, 0.8, 0.6)


@dataclass(frozen=True)
class _Parameter:
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
        approach: of those who stood on this road alone; empty: on any that has none of its own.
        gain: how far the parameter moves for a figure that is off by one, where not a ratio.
    """

    field: str
    usual: float
    least: float
    most: float
    sample: Callable[[Measured], list[Any]]
    figure: Callable[[list[Any]], float]
    ratio: bool
    what: str
    fewest: int = _FEWEST
    classes: tuple[str, ...] = ()
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


_PARAMETERS = (
    _Parameter(
        *("speed_factor", 1.0, 0.4, 1.5),
        lambda part: part.free,
        *(_median, True, "speeds of who leaves with nobody close ahead, of the limit", _FREE),
    ),
    _Parameter(
        *("speed_factor", 1.0, 0.4, 1.5),
        lambda part: sorted(part.tops)[len(part.tops) // 2 :],
        *(_median, True, "best speeds of the quicker half, as shares of the limit"),
    ),
    _Parameter(
        *("speed_spread", 0.1, 0.01, 0.3),
        lambda part: part.free,
        *(_quartiles_apart, True, "spreads of such speeds", _FREE),
    ),
    _Parameter(
        *("acceleration", 2.6, 0.8, 4.5),
        lambda part: part.accelerations,
        *(_median, True, "accelerations from 1 to 5 m/s, m/s2"),
    ),
    _Parameter(
        *("acceleration", 2.6, 0.4, 4.5),
        lambda part: part.heavy_accelerations,
        *(_median, True, "accelerations from 1 to 5 m/s, m/s2", _MANY),
        classes=HEAVY,
    ),
    _Parameter(
        *("acceleration_at_10", 2.6, 0.3, 4.5),
        lambda part: part.faded,
        *(_median, True, "accelerations from 6 to 9 m/s, m/s2"),
    ),
    _Parameter(
        *("acceleration_at_10", 2.6, 0.3, 4.5),
        lambda part: part.heavy_faded,
        *(_median, True, "accelerations from 6 to 9 m/s, m/s2", _MANY),
        classes=HEAVY,
    ),
    _Parameter(
        *("sideways_acceleration", SIDEWAYS_MS2, 1.0, 6.0),
        lambda part: part.bends,
        *(_median, True, "accelerations to the side in turns, m/s2"),
    ),
    _Parameter(
        *("standing_gap_m", 2.0, 0.5, 6.0),
        lambda part: part.gaps,
        *(_median, False, "gaps of who stands behind each other, m"),
    ),
    _Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.following,
        *(_near, False, "times from bumper to bumper of who follows, s", _MANY),
    ),
    _Parameter(
        *(_QUEUES, 1.35, 0.5, 4.0),
        lambda part: part.all_discharge,
        *(_median, False, "times between who leaves a queue at the stop line, s", _MANY),
        gain=2.0,  # who sets out at the stop line does not yet drive as it would in the end
    ),
    _Parameter(
        *("headway_s", 1.35, 0.5, 3.0),
        lambda part: part.all_headways[part.all_headways <= _FOLLOWS_S].tolist(),
        *(_median, False, "headways of who follows at the stop line, s"),
    ),
    _Parameter(
        *("critical_gap_s", 1.0, 0.1, 8.0),
        lambda part: part.gap_choices if any(gap > 0 for gap, _ in part.gap_choices) else [],
        *(critical_gap, False, "choices of a gap by who gives way, s", _MANY),
    ),
)


def fitted_drivers(
    recorded: Measured,
    simulated: Callable[[Mapping[str, float], int], Measured],
    *,
    rounds: int = ROUNDS,
) -> tuple[dict[str, float], list[dict[str, Any]], list[str]]:
    """Return drivers for whom a simulation shows the figures of a recording.

    Headways of single approaches are drawn towards those of all: n / (n + 20) of the way is theirs.

    Args:
        recorded: what is fitted to.
        simulated: measures a simulation with such drivers; the number of the round is for telling.
        rounds: how many simulations.

    Returns:
        The fields of ``traffic.drivers``, as `of_classes` and `of_approaches` take them; by field
        what was recorded, what is simulated, of how many values; and what could not be told.
    """
    first: dict[str, _Parameter] = {}
    for one in _PARAMETERS:
        if len(one.sample(recorded)) >= one.fewest:
            first.setdefault(one.name, one)
    known = list(first.values())
    apart = _by_approach(recorded) if _QUEUES in first else []
    untold = [
        f"{one.name}: {len(one.sample(recorded))} {one.what} are too few, "
        + ("as the others" if one.classes else "the usual stays")
        for one in {one.name: one for one in _PARAMETERS}.values()
        if one.name not in first and (not one.classes or one.sample(recorded))
    ]
    wanted = {one.name: one.figure(one.sample(recorded)) for one in known}
    for one in apart:
        own = one.figure(one.sample(recorded))
        wanted[one.name] = shrunk(own, wanted[_QUEUES], len(one.sample(recorded)))
    known += apart
    # Together they weigh as much as any other figure.
    weight = {one.name: 1 / len(apart) if one.approach else 1.0 for one in known}
    error = {one.name: _error(one, recorded) for one in known}
    drivers = {one.name: one.usual for one in known}
    best: tuple[float, dict[str, float], dict[str, float]] = (np.inf, dict(drivers), {})
    for turn in range(rounds if known else 0):
        part = simulated(drivers, turn)
        values = {one.name: one.sample(part) for one in known}
        shown = {
            one.name: one.figure(values[one.name])
            for one in known
            if len(values[one.name]) >= _FEWEST
        }
        # In what the recording itself does not tell: figures of few weigh less.
        off = {
            name: abs(shown[name] - goal) / max(error[name], _SAME * goal, 1e-9)
            if name in shown
            else _NONE_SHOWN
            for name, goal in wanted.items()
        }
        mean = sum(weight[name] * one for name, one in off.items()) / sum(weight.values())
        whole = mean + _distances(recorded, part)
        if whole < best[0]:
            best = whole, dict(drivers), shown
        if max(off.values()) <= 1:
            break
        step = _STEPS[min(turn, len(_STEPS) - 1)]
        for one in known:
            if one.name not in shown:
                continue
            goal, now = wanted[one.name], max(shown[one.name], 1e-3)
            value = drivers[one.name]
            by = step * len(values[one.name]) / (len(values[one.name]) + _FEW)
            moved = (
                value * (goal / now) ** by if one.ratio else value + by * one.gain * (goal - now)
            )
            drivers[one.name] = round(float(np.clip(moved, one.least, one.most)), 3)
        _keep_in_order(drivers)
    _, drivers, shown = best
    told = [
        {
            "field": one.field,
            **({"classes": list(one.classes)} if one.classes else {}),
            **({"approach": one.approach} if one.approach else {}),
            "value": drivers[one.name],
            "of": one.what,
            "recorded": round(wanted[one.name], 3),
            "standard_error": round(error[one.name], 3),
            "simulated": round(shown[one.name], 3) if one.name in shown else None,
            "count": len(one.sample(recorded)),
        }
        for one in known
    ]
    return drivers, told, untold


def _distances(recorded: Measured, part: Measured) -> float:
    """Return how far distributions of speed and headway are off, in what is wanted of them."""
    told = agreement(recorded, part)
    both = (told["speed_ks"], told["headway_ks"])
    return sum(1.0 if one is None else float(one) / _WANTED_KS for one in both)


def _keep_in_order(drivers: dict[str, float]) -> None:
    """Let no field be more than one that it follows from."""
    if _QUEUES in drivers and "headway_s" in drivers:
        # Who moves on keeps no more than who has stood: queues would be held up beyond the line.
        drivers["headway_s"] = min(drivers["headway_s"], drivers[_QUEUES])
    for name, value in drivers.items():
        if name.startswith("acceleration_at_10"):  # it falls with the speed
            most = drivers.get(name.replace("_at_10", ""), np.inf)
            drivers[name] = min(value, most)


def _by_approach(recorded: Measured) -> list[_Parameter]:
    """Return the headways of queues, approach by approach, where many left one on several."""
    if len(recorded.discharge) < 2:
        return []

    def discharge(approach: str) -> Callable[[Measured], list[Any]]:
        return lambda part: part.discharge.get(approach, [])

    (every,) = (one for one in _PARAMETERS if one.name == _QUEUES)
    return [
        replace(every, sample=discharge(name), approach=name)
        for name, values in sorted(recorded.discharge.items())
        if len(values) >= FEWEST
    ]


def _error(one: _Parameter, recorded: Measured) -> float:
    """Return the standard error of a figure: of values drawn again from those recorded."""
    values = np.array(one.sample(recorded))
    random = np.random.Generator(np.random.Philox(key=[1, 2001]))
    drawn = random.integers(0, len(values), (_DRAWN_AGAIN, len(values)))
    return float(np.std([one.figure(values[row].tolist()) for row in drawn]))


def of_classes(drivers: Mapping[str, float], seen: Collection[str]) -> dict[str, dict[str, float]]:
    """Return ``traffic.drivers`` of the classes of motor traffic that were seen.

    Args:
        drivers: what `fitted_drivers` finds.
        seen: classes.
    """
    found: dict[str, dict[str, float]] = {}
    for name in (one for one in MOTORS if one in seen):
        mine = {one.field: one for one in _PARAMETERS if not one.classes}
        mine |= {one.field: one for one in _PARAMETERS if name in one.classes}
        told = {field: drivers.get(one.name, drivers.get(field)) for field, one in mine.items()}
        found[name] = {field: value for field, value in told.items() if value is not None}
    return found


def of_approaches(drivers: Mapping[str, float]) -> dict[str, float]:
    """Return by road the headway of who has stood on it, of what `fitted_drivers` finds."""
    start = f"{_QUEUES} on "
    return {
        name.removeprefix(start): value for name, value in drivers.items() if name.startswith(start)
    }
