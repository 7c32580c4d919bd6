"""How drivers drive: parameters for which a simulation shows what was recorded.

Indirect inference (Gourieroux, Monfort and Renault, Journal of Applied Econometrics 8, 1993): each
parameter has a figure of the traffic that moves with it. The same figure is taken of the recording
and of a simulation; the parameter is moved by the difference, and simulated again. What queues,
signals and the way of measuring do to the figure, they do on both sides.
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

#: Simulations at most; fewer where distributions are as near as is wanted, and all figures as what
#: was recorded and what was simulated tell: 1 standard error of both in the mean, the furthest so
#: many.
ROUNDS = 10
_NEAR = 2.5
#: A parameter moves half as far if so few values are simulated; and a figure that is not simulated
#: is so many times as far off as the recording tells it.
_FEW, _NONE_SHOWN = 5, 20.0
#: Distributions are to be as near as this (Kolmogorov-Smirnov).
_WANTED_KS = 0.1
_DRAWN_AGAIN = 200
#: A figure that differs by no more is the same.
_SAME = 0.02
#: How a figure answers to its parameter is learned of so many last simulations (the first had
#: other drivers in everything else), each counting so much of the next; what is expected of it
#: counts as values so far apart (of their size); and it is between these shares of that.
_LAST, _FADES, _EXPECTED_OVER, _ANSWERS = 4, 0.6, 0.15, (0.4, 2.5)
#: A parameter moves no further at once, of its size (what goes with a power of its figure: so
#: much of the figure's).
_FURTHEST = 0.75


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
    first: dict[str, Parameter] = {}
    for one in PARAMETERS:
        if len(one.sample(recorded)) >= one.fewest:
            first.setdefault(one.name, one)
    known = [where_it_shows(one, recorded) for one in first.values()]
    apart = by_approach(recorded) if QUEUES in first else []
    untold = [
        f"{one.name}: {len(one.sample(recorded))} {one.what} are too few, "
        + ("as the others" if one.classes else "the usual stays")
        for one in {one.name: one for one in PARAMETERS}.values()
        if one.name not in first and (not one.classes or one.sample(recorded))
    ]
    wanted = {one.name: one.figure(one.sample(recorded)) for one in known}
    for one in apart:
        own = one.figure(one.sample(recorded))
        wanted[one.name] = shrunk(own, wanted[QUEUES], len(one.sample(recorded)))
    if apart:
        # Where each is told by itself, all of them do not tell the class's own once more.
        known = [one for one in known if one.name != QUEUES] + [
            one for one in [elsewhere(apart)] if len(one.sample(recorded)) >= one.fewest
        ]
        wanted |= {one.name: one.figure(one.sample(recorded)) for one in known}
    known += apart
    # Together they weigh as much as any other figure.
    weight = {one.name: 1 / len(apart) if one.approach else 1.0 for one in known}
    error = {one.name: _error(one, recorded) for one in known}
    counts = {one.name: len(one.sample(recorded)) for one in known}
    drivers = {one.name: one.usual for one in known}
    simulations: dict[str, list[tuple[float, float, int]]] = {one.name: [] for one in known}
    best: tuple[float, dict[str, float], dict[str, float]] = (np.inf, dict(drivers), {})
    for turn in range(rounds if known else 0):
        part = simulated(_with_queues(drivers, counts), turn)
        values = {one.name: one.sample(part) for one in known}
        shown = {
            one.name: one.figure(values[one.name])
            for one in known
            if len(values[one.name]) >= FEWEST_VALUES
        }
        # In what recording and simulation themselves do not tell: figures of few weigh less.
        off = {
            one.name: _off(one, shown[one.name], wanted[one.name], error[one.name], both)
            if one.name in shown
            else _NONE_SHOWN
            for one in known
            for both in [(counts[one.name], len(values[one.name]))]
        }
        mean = sum(weight[name] * one for name, one in off.items()) / sum(weight.values())
        speeds, headways = _distances(recorded, part)
        whole = mean + speeds + headways
        if whole < best[0]:
            best = whole, dict(drivers), shown
        if max(off.values()) <= _NEAR and max(mean, speeds, headways) <= 1:
            break
        for one in known:
            if one.name in shown:
                figure = max(shown[one.name], 1e-3)
                simulations[one.name].append((drivers[one.name], figure, len(values[one.name])))
                moved = _moved(one, wanted[one.name], simulations[one.name])
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
            "count": counts[one.name],
        }
        for one in known
    ]
    return _with_queues(drivers, counts), told, untold


def _with_queues(drivers: Mapping[str, float], counts: Mapping[str, int]) -> dict[str, float]:
    """Return drivers with a headway of queues elsewhere: where no figure tells it, the mean.

    Args:
        drivers: whose queues on single approaches are told, and perhaps those on all others.
        counts: of how many values each figure is.
    """
    queues = {name: value for name, value in drivers.items() if name.startswith(f"{QUEUES} on ")}
    if not queues or QUEUES in drivers:
        return dict(drivers)
    mean = sum(counts[name] * value for name, value in queues.items())
    return {**drivers, QUEUES: round(mean / sum(counts[name] for name in queues), 3)}


def _off(one: Parameter, shown: float, goal: float, error: float, counts: tuple[int, int]) -> float:
    """Return how far a figure is off, in standard errors of what was recorded and simulated."""
    recorded, simulated = counts
    both = error * float(np.sqrt(1 + recorded / max(simulated, 1)))
    return abs(shown - goal) / max(both, _SAME * goal, 1e-9)


def _moved(one: Parameter, goal: float, simulations: Sequence[tuple[float, float, int]]) -> float:
    """Return a parameter for which its figure comes to what is wanted, by what was simulated.

    A line through what was simulated, late simulations and those of many values before others
    (weighted least squares), whose slope is drawn towards the one expected: for one simulation that
    is a step with the expected slope, for more a secant through noise.

    Args:
        one: the parameter.
        goal: the figure that is wanted.
        simulations: value, figure, and of how many values, in the order of the rounds.
    """
    value, figure, count = np.array(simulations[-_LAST:], np.float64).T
    if one.ratio:
        value, figure, goal = np.log(value), np.log(figure), float(np.log(goal))
    fades = _FADES ** np.arange(len(value))[::-1]
    trust = count / (count + _FEW)
    weight = fades * trust / (fades * trust).sum()
    x, y = float(weight @ value), float(weight @ figure)
    expected = 1.0 / one.gain
    over = _EXPECTED_OVER * (1.0 if one.ratio else one.usual)
    slope = (expected * over**2 + weight @ ((value - x) * (figure - y))) / (
        over**2 + weight @ (value - x) ** 2
    )
    least, most = _ANSWERS
    slope = float(np.clip(slope, expected * least, expected * most))
    aim = x + float(trust[-1]) * (goal - y) / slope
    furthest = one.gain * float(np.log1p(_FURTHEST)) if one.ratio else _FURTHEST * one.usual
    aim = float(np.clip(aim, value[-1] - furthest, value[-1] + furthest))
    return float(np.exp(aim)) if one.ratio else aim


def _distances(recorded: Measured, part: Measured) -> tuple[float, float]:
    """Return how far distributions of speed and headway are off, in what is wanted of them."""
    told = agreement(recorded, part)
    speeds, headways = (
        1.0 if one is None else float(one) / _WANTED_KS
        for one in (told["speed_ks"], told["headway_ks"])
    )
    return speeds, headways


def _keep_in_order(drivers: dict[str, float]) -> None:
    """Let no field be more than one that it follows from."""
    for name, value in drivers.items():
        if name.startswith("acceleration_at_10"):  # it falls with the speed
            most = drivers.get(name.replace("_at_10", ""), np.inf)
            drivers[name] = min(value, most)


def _error(one: Parameter, recorded: Measured) -> float:
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
        mine = {one.field: one for one in PARAMETERS if not one.classes}
        mine |= {one.field: one for one in PARAMETERS if name in one.classes}
        told = {field: drivers.get(one.name, drivers.get(field)) for field, one in mine.items()}
        found[name] = {field: value for field, value in told.items() if value is not None}
    return found


def of_approaches(drivers: Mapping[str, float]) -> dict[str, float]:
    """Return by road the headway of who has stood on it, of what `fitted_drivers` finds."""
    start = f"{QUEUES} on "
    return {
        name.removeprefix(start): value for name, value in drivers.items() if name.startswith(start)
    }
