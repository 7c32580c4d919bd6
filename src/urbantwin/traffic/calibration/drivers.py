"""Driver parameters for which a simulation agrees with a recording.

Indirect inference (Gourieroux, Monfort and Renault, Journal of Applied Econometrics 8, 1993): each
parameter has a statistic of the traffic that depends on it. The statistic is computed from the
recording and from a simulation; the parameter is changed by the difference, and the simulation
repeated. Effects of queues, signals and measurement are the same on both sides.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.traffic.calibration.agreement import agreement
from urbantwin.traffic.calibration.driver_parameters import (
    FEWEST_VALUES,
    PARAMETERS,
    QUEUES,
    Parameter,
    by_approach,
    elsewhere,
    where_it_shows,
)
from urbantwin.traffic.calibration.lane_use import shrunk
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import MOTORS

__all__ = ["ROUNDS", "fitted_drivers", "of_approaches", "of_classes"]

#: Maximum number of simulations. Fewer suffice once distributions are as near as required, and the
#: mean deviation of statistics is at most 1 standard error, the largest at most ``_NEAR_ERRORS``.
ROUNDS = 10
_NEAR_ERRORS = 2.5
#: A parameter moves half as far if its statistic has this many simulated values; and deviation, in
#: standard errors, of a statistic without simulated values.
_MIN_SIMULATED, _UNSEEN_DEVIATION = 5, 20.0
#: Required Kolmogorov-Smirnov distance of distributions.
_WANTED_KS = 0.1
_BOOTSTRAPS = 200
#: Relative deviation of a statistic that counts as equal.
_EQUAL_SHARE = 0.02
#: The response of a statistic to its parameter is estimated from this number of last simulations
#: (earlier ones had other drivers in all respects), with this weight from one to the next. The
#: prior slope weighs as much as values this far apart (relative to their size); the slope is
#: limited to these multiples of the prior.
_LAST_RUNS, _RUN_WEIGHT_DECAY, _EXPECTED_OVER, _SLOPE_LIMITS = 4, 0.6, 0.15, (0.4, 2.5)
#: Maximum relative change of a parameter at once (for a power of the statistic, of the statistic).
_MAX_CHANGE = 0.75


def fitted_drivers(
    recorded: Measured,
    simulated: Callable[[Mapping[str, float], int], Measured],
    *,
    rounds: int = ROUNDS,
) -> tuple[dict[str, float], list[dict[str, Any]], list[str]]:
    """Return drivers whose simulation reproduces the statistics of a recording.

    Headways of single approaches are shrunk towards the common one, with the weight n / (n + 20).

    Args:
        recorded: the measurement that is fitted to.
        simulated: measures a simulation with given drivers; the round's number is for progress.
        rounds: maximum number of simulations.

    Returns:
        The fields of ``traffic.drivers``, in the form of `of_classes` and `of_approaches`; a report
            by field of recorded and simulated values and their numbers; and what could not be
            fitted.
    """
    first: dict[str, Parameter] = {}
    for parameter in PARAMETERS:
        if len(parameter.sample(recorded)) >= parameter.fewest:
            first.setdefault(parameter.name, parameter)
    fitted = [where_it_shows(parameter, recorded) for parameter in first.values()]
    apart = by_approach(recorded) if QUEUES in first else []
    untold = [
        f"{parameter.name}: {len(parameter.sample(recorded))} {parameter.what} are too few, "
        + ("as the others" if parameter.classes else "the usual stays")
        for parameter in {parameter.name: parameter for parameter in PARAMETERS}.values()
        if parameter.name not in first and (not parameter.classes or parameter.sample(recorded))
    ]
    wanted = {parameter.name: parameter.figure(parameter.sample(recorded)) for parameter in fitted}
    for parameter in apart:
        own = parameter.figure(parameter.sample(recorded))
        wanted[parameter.name] = shrunk(own, wanted[QUEUES], len(parameter.sample(recorded)))
    if apart:
        # If approaches are fitted separately, the common statistic covers only the others.
        fitted = [parameter for parameter in fitted if parameter.name != QUEUES] + [
            parameter
            for parameter in [elsewhere(apart)]
            if len(parameter.sample(recorded)) >= parameter.fewest
        ]
        wanted |= {
            parameter.name: parameter.figure(parameter.sample(recorded)) for parameter in fitted
        }
    fitted += apart
    # Together they weigh as much as any other statistic.
    weight = {parameter.name: 1 / len(apart) if parameter.approach else 1.0 for parameter in fitted}
    error = {parameter.name: _error(parameter, recorded) for parameter in fitted}
    counts = {parameter.name: len(parameter.sample(recorded)) for parameter in fitted}
    drivers = {parameter.name: parameter.usual for parameter in fitted}
    simulations: dict[str, list[tuple[float, float, int]]] = {
        parameter.name: [] for parameter in fitted
    }
    best: tuple[float, dict[str, float], dict[str, float]] = (np.inf, dict(drivers), {})
    for turn in range(rounds if fitted else 0):
        part = simulated(_with_queues(drivers, counts), turn)
        values = {parameter.name: parameter.sample(part) for parameter in fitted}
        shown = {
            parameter.name: parameter.figure(values[parameter.name])
            for parameter in fitted
            if len(values[parameter.name]) >= FEWEST_VALUES
        }
        # In standard errors of recording and simulation: statistics of few values weigh less.
        off = {
            parameter.name: _deviation(
                parameter,
                shown[parameter.name],
                wanted[parameter.name],
                error[parameter.name],
                both,
            )
            if parameter.name in shown
            else _UNSEEN_DEVIATION
            for parameter in fitted
            for both in [(counts[parameter.name], len(values[parameter.name]))]
        }
        mean = sum(weight[name] * deviation for name, deviation in off.items()) / sum(
            weight.values()
        )
        speeds, headways = _distances(recorded, part)
        whole = mean + speeds + headways
        if whole < best[0]:
            best = whole, dict(drivers), shown
        if max(off.values()) <= _NEAR_ERRORS and max(mean, speeds, headways) <= 1:
            break
        for parameter in fitted:
            if parameter.name in shown:
                figure = max(shown[parameter.name], 1e-3)
                simulations[parameter.name].append(
                    (drivers[parameter.name], figure, len(values[parameter.name]))
                )
                moved = _updated_parameter(
                    parameter, wanted[parameter.name], simulations[parameter.name]
                )
                drivers[parameter.name] = round(
                    float(np.clip(moved, parameter.least, parameter.most)), 3
                )
        _keep_in_order(drivers)
    _, drivers, shown = best
    rows = [
        {
            "field": parameter.field,
            **({"classes": list(parameter.classes)} if parameter.classes else {}),
            **({"approach": parameter.approach} if parameter.approach else {}),
            "value": drivers[parameter.name],
            "of": parameter.what,
            "recorded": round(wanted[parameter.name], 3),
            "standard_error": round(error[parameter.name], 3),
            "simulated": round(shown[parameter.name], 3) if parameter.name in shown else None,
            "count": counts[parameter.name],
        }
        for parameter in fitted
    ]
    return _with_queues(drivers, counts), rows, untold


def _with_queues(drivers: Mapping[str, float], counts: Mapping[str, int]) -> dict[str, float]:
    """Return drivers with a queue headway for other approaches: the mean, if it was not fitted.

    Args:
        drivers: headways of single approaches, and possibly of all others.
        counts: number of values of each statistic.
    """
    queues = {name: value for name, value in drivers.items() if name.startswith(f"{QUEUES} on ")}
    if not queues or QUEUES in drivers:
        return dict(drivers)
    mean = sum(counts[name] * value for name, value in queues.items())
    return {**drivers, QUEUES: round(mean / sum(counts[name] for name in queues), 3)}


def _deviation(
    one: Parameter, shown: float, goal: float, error: float, counts: tuple[int, int]
) -> float:
    """Return the deviation of a statistic, in standard errors of recording and simulation."""
    recorded, simulated = counts
    both = error * float(np.sqrt(1 + recorded / max(simulated, 1)))
    return abs(shown - goal) / max(both, _EQUAL_SHARE * goal, 1e-9)


def _updated_parameter(
    one: Parameter, goal: float, simulations: Sequence[tuple[float, float, int]]
) -> float:
    """Return the parameter whose statistic should equal the goal, estimated from simulations.

    A line is fitted to the simulations by weighted least squares, with more weight on late ones and
    on those with many values. Its slope is shrunk towards the prior: one simulation gives a step
    with the prior slope, several a secant with noise.

    Args:
        one: the parameter.
        goal: value of the statistic that is required.
        simulations: value, statistic, and number of values, in the order of the rounds.
    """
    value, figure, count = np.array(simulations[-_LAST_RUNS:], np.float64).T
    if one.ratio:
        value, figure, goal = np.log(value), np.log(figure), float(np.log(goal))
    fades = _RUN_WEIGHT_DECAY ** np.arange(len(value))[::-1]
    trust = count / (count + _MIN_SIMULATED)
    weight = fades * trust / (fades * trust).sum()
    x, y = float(weight @ value), float(weight @ figure)
    expected = 1.0 / one.gain
    over = _EXPECTED_OVER * (1.0 if one.ratio else one.usual)
    slope = (expected * over**2 + weight @ ((value - x) * (figure - y))) / (
        over**2 + weight @ (value - x) ** 2
    )
    least, most = _SLOPE_LIMITS
    slope = float(np.clip(slope, expected * least, expected * most))
    aim = x + float(trust[-1]) * (goal - y) / slope
    furthest = one.gain * float(np.log1p(_MAX_CHANGE)) if one.ratio else _MAX_CHANGE * one.usual
    aim = float(np.clip(aim, value[-1] - furthest, value[-1] + furthest))
    return float(np.exp(aim)) if one.ratio else aim


def _distances(recorded: Measured, part: Measured) -> tuple[float, float]:
    """Return the distances of speed and headway distributions, relative to the requirement."""
    distances = agreement(recorded, part)
    speeds, headways = (
        1.0 if distance is None else float(distance) / _WANTED_KS
        for distance in (distances["speed_ks"], distances["headway_ks"])
    )
    return speeds, headways


def _keep_in_order(drivers: dict[str, float]) -> None:
    """Limit fields by those that bound them."""
    for name, value in drivers.items():
        if name.startswith("acceleration_at_10"):  # it decreases with speed
            most = drivers.get(name.replace("_at_10", ""), np.inf)
            drivers[name] = min(value, most)


def _error(one: Parameter, recorded: Measured) -> float:
    """Return the standard error of a statistic, by bootstrap of the recorded values."""
    values = np.array(one.sample(recorded))
    random = np.random.Generator(np.random.Philox(key=[1, 2001]))
    drawn = random.integers(0, len(values), (_BOOTSTRAPS, len(values)))
    return float(np.std([one.figure(values[row].tolist()) for row in drawn]))


def of_classes(drivers: Mapping[str, float], seen: Collection[str]) -> dict[str, dict[str, float]]:
    """Return ``traffic.drivers`` of the observed classes of motor traffic.

    Args:
        drivers: result of `fitted_drivers`.
        seen: the observed classes.
    """
    by_class: dict[str, dict[str, float]] = {}
    for name in (actor_class for actor_class in MOTORS if actor_class in seen):
        of_class = {parameter.field: parameter for parameter in PARAMETERS if not parameter.classes}
        of_class |= {
            parameter.field: parameter for parameter in PARAMETERS if name in parameter.classes
        }
        values = {
            field: drivers.get(parameter.name, drivers.get(field))
            for field, parameter in of_class.items()
        }
        by_class[name] = {field: value for field, value in values.items() if value is not None}
    return by_class


def of_approaches(drivers: Mapping[str, float]) -> dict[str, float]:
    """Return the queue headway by road, from the result of `fitted_drivers`."""
    start = f"{QUEUES} on "
    return {
        name.removeprefix(start): value for name, value in drivers.items() if name.startswith(start)
    }
