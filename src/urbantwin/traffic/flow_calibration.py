"""Calibration of the circulating population to the flow per hour that was asked for.

The flow of a closed network is its population times its mean speed over the length of the way
round. The speed depends on signals and on how many there are, so it is measured: by short pilot
simulations, each with the population that the speed seen in the one before asks for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.circulation import Circulation
from urbantwin.traffic.demand import Population
from urbantwin.traffic.simulation import Observed, observe

__all__ = ["Calibrated", "calibrate"]

#: Length of a pilot, the start of it that does not count, and SUMO's step.
PILOT_S, SETTLING_MIN, STEP_MS = 360, 2, 500
#: Pilots at most, and what is near enough to the wish.
PILOTS, TOLERANCE = 4, 0.08
#: Speed as a share of free speed before anything is known.
FIRST_GUESS = {"motor": 0.5, "bicycle": 0.7, "pedestrian": 0.85}
#: The first pilot is one of little traffic, of this share of what was asked for.
LITTLE = 0.25
#: More traffic than slows everybody down to this share of the speed in little traffic is not let
#: in: beyond, fixed-time signals are oversaturated, queues grow and reach back into junctions.
SLOWEST = 0.65
#: Nor are there ever more vehicles than this share of those that fit onto the lanes bumper to
#: bumper. Urban networks carry most at about a quarter of the jam density (Geroliminis and
#: Daganzo, Transportation Research B 42, 2008), and lock up soon beyond.
FULLEST = 0.17
#: By how much the traffic is lessened until it flows.
LESS = 0.8


@dataclass(frozen=True)
class Calibrated:
    """The population, and the share of the vehicles asked for that the streets can carry."""

    populations: list[Population]
    carried: float


def calibrate(
    circulation: Circulation,
    net_path: Path,
    *,
    room: float,
    asset: Callable[[str], Asset],
    asset_names: Callable[[str], tuple[str, ...]],
    scratch: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Calibrated:
    """Find the population that the wanted flow needs, or less where the streets cannot carry it.

    Args:
        circulation: the closed network.
        net_path: the SUMO network.
        room: how many cars fit onto the network's lanes bumper to bumper.
        asset: the mesh of a name.
        asset_names: the meshes of a class.
        scratch: a folder for SUMO's files; the system's when not given.
        progress: called with the fraction done.

    Raises:
        StageError: SUMO failed.
    """

    def pilot(populations: list[Population]) -> dict[str, float]:
        demand = circulation.demand(
            populations, warmup_s=0.0, duration_s=PILOT_S, asset_names=asset_names
        )
        if not demand.trips:
            return pace
        seen = observe(
            net_path,
            demand,
            asset,
            seconds=PILOT_S,
            step_ms=STEP_MS,
            seed=circulation.seed,
            scratch=scratch,
        )
        return _pace(populations, seen.observed, pace)

    def planned(pace: Mapping[str, float], carried: float) -> list[Population]:
        return circulation.populations(_by_class(pace), carried=carried)

    pace = dict(FIRST_GUESS)
    pace = pilot(planned(pace, LITTLE))
    least = SLOWEST * pace["motor"]
    carried = 1.0
    for number_done in range(PILOTS):
        if progress:
            progress((1 + number_done) / (1 + PILOTS))
        number = _vehicles(planned(pace, carried))
        if number > FULLEST * room:
            carried *= FULLEST * room / number
        populations = planned(pace, carried)
        pace = pilot(populations)
        if pace["motor"] < least:
            carried *= LESS
            pace["motor"] = least
            continue
        wanted, number = _vehicles(planned(pace, carried)), _vehicles(populations)
        if abs(wanted - number) <= max(1.0, TOLERANCE * number):
            break
    return Calibrated(planned(pace, carried), carried)


def _kind(actor_class: str) -> str:
    return actor_class if actor_class in FIRST_GUESS else "motor"


def _by_class(pace: Mapping[str, float]) -> dict[str, float]:
    return {name: pace[_kind(name)] for name in ACTOR_CLASSES}


def _vehicles(populations: list[Population]) -> int:
    return sum(group.count for group in populations if _kind(group.actor_class) == "motor")


def _pace(
    populations: list[Population], seen: Observed, before: Mapping[str, float]
) -> dict[str, float]:
    """Return the mean speed of each kind of actors as a share of the free speed."""
    took, free = dict.fromkeys(before, 0.0), dict.fromkeys(before, 0.0)
    for group in populations:
        column, kind = ACTOR_CLASSES.index(group.actor_class), _kind(group.actor_class)
        took[kind] += float(seen.samples[SETTLING_MIN:, column].sum())
        free[kind] += float(seen.metres[SETTLING_MIN:, column].sum()) / (
            group.metres / group.seconds
        )
    return {
        kind: max(free[kind] / took[kind], 0.02) if took[kind] else before[kind] for kind in before
    }
