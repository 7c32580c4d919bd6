"""Calibration of the circulating population to the flow per hour that was asked for.

The flow of a closed network is its population times its mean speed over the length of the way
round. It grows with the population until junctions are saturated, and falls when queues reach back
into them (the network's fundamental diagram: Geroliminis and Daganzo, Transportation Research B 42,
2008). So it is measured, by a few short pilot simulations of growing populations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.demand import Population
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.simulation import observe
from urbantwin.traffic.sumo.tram_conflicts import tram_conflicts

__all__ = ["SURE", "Calibrated", "calibrate"]

#: Length of a pilot, the start of it that does not count, and SUMO's step.
PILOT_S, SETTLING_MIN, STEP_MS = 480, 3, 500
#: Pilots at most after the first, and what is near enough to the wish.
PILOTS, TOLERANCE = 5, 0.06
#: Speed as a share of free speed before anything is known.
FIRST_GUESS = {"motor": 0.5, "bicycle": 0.7, "pedestrian": 0.85, "tram": 0.5}
#: The first pilot is one of little traffic, of this share of what was asked for.
LITTLE = 0.25
#: There are never more vehicles than this share of those that fit onto the lanes bumper to bumper.
#: Urban networks carry most at about a quarter of the jam density (Geroliminis and Daganzo).
FULLEST = 0.3
#: From pilot to pilot the population grows at most so many times.
GROWTH = 1.6
#: More vehicles that raise the flow by less than this share of their number only stand in queues.
WORTHWHILE = 0.3
#: A flow that falls below this share within a pilot is that of streets that lock up.
FALLS = 0.6
#: Share of the time that the short ones take, about.
IN_MINUTES = 0.4
#: Longer pilots show the flow once queues have grown: their length, the minutes at their start that
#: do not count, and how many there are at most. Shorter ones see two or three cycles; their flow
#: differs from an hour's by a tenth and more.
LONG_S, LONG_SETTLING_MIN, LONG_PILOTS = 1500, 5, 5
#: The longest halt of a vehicle in them, seconds, beyond which the population is reduced by this
#: factor, after two such pilots by the next; and the least and largest factor by which it grows
#: where it carries less than was asked for.
LONGEST_HALT_S, LESS, FAR_LESS, MORE = 200.0, 0.75, 0.5, (1.08, 1.25)
#: Share of a longer pilot's flow that an hour carries too: the pilot sees 10 to 20 cycles.
SURE = 0.95
#: Of populations whose flows differ by no more than this the smallest is taken: it is farthest from
#: locking up.
ALIKE = 0.05


@dataclass(frozen=True)
class Calibrated:
    """The population, and what the streets carry.

    Attributes:
        populations: how many of each class.
        carried: share of the motor traffic asked for that they carry; 1 where it is nearly all.
        standing: lane -> how many vehicles stood on it, in the mean, in the pilot of this.
        pace: by kind, the mean speed in little traffic as a share of the free speed.
        size: times the population that would do at that speed.
    """

    populations: list[Population]
    carried: float
    standing: Mapping[str, float] = field(default_factory=dict)
    pace: Mapping[str, float] = field(default_factory=dict)
    size: float = 1.0

    def as_asked(self) -> Calibrated:
        """Return the same population, with what it surely carries for what was asked for."""
        populations = [
            replace(group, per_hour=group.per_hour * self.carried * SURE)
            if _kind(group.actor_class) == "motor"
            else group
            for group in self.populations
        ]
        return replace(self, populations=populations, carried=1.0)


@dataclass(frozen=True)
class _Pilot:
    """A pilot: times the population that would do at the speed in little traffic, and its flow.

    ``flow`` is a share of what was asked for, ``queued`` how long vehicles stood on each lane.
    """

    size: float
    flow: float
    pace: Mapping[str, float]
    queued: Mapping[str, float]
    seconds: int = PILOT_S
    longest_halt_s: float = 0.0


def calibrate(  # noqa: PLR0913
    circulation: Circulation,
    net_path: Path,
    *,
    roads: RoadNetwork | None = None,
    room: float,
    asset: Callable[[str], Asset],
    body: Callable[[str, int], str],
    scratch: Path | None = None,
    progress: Callable[[float], None] | None = None,
    after: Calibrated | None = None,
) -> Calibrated:
    """Find the population that the wanted flow needs, or less where the streets cannot carry it.

    Args:
        circulation: the closed network.
        net_path: the SUMO network.
        roads: its lanes, where trams meet other traffic.
        room: how many cars fit onto the network's lanes bumper to bumper.
        asset: the mesh of a name.
        body: the asset of the n-th actor of a class.
        scratch: a folder for SUMO's files; the system's when not given.
        progress: called with the fraction done.
        after: what was found with a little more traffic: how fast it is, and where to begin.

    Raises:
        StageError: SUMO failed.
    """
    trams = tram_conflicts(net_path, roads)

    def pilot(
        size: float, motor: float, others: Mapping[str, float], seconds: int = PILOT_S
    ) -> _Pilot:
        populations = circulation.populations(_by_class({**others, "motor": motor}), carried=size)
        demand = circulation.demand(populations, warmup_s=0.0, duration_s=seconds, body=body)
        if not demand.trips:
            return _Pilot(size, 1.0, others, {})
        seen = observe(
            net_path,
            demand,
            asset,
            seconds=seconds,
            step_ms=STEP_MS,
            seed=circulation.seed,
            trams=trams,
            scratch=scratch,
        ).observed
        flow = _flow(populations, seen, SETTLING_MIN if seconds == PILOT_S else LONG_SETTLING_MIN)
        pace, halt_s = _pace(populations, seen, others), seen.vehicle_halt_s
        return _Pilot(size, flow, pace, seen.queued, seconds, halt_s)

    if after is None:
        little = pilot(LITTLE, FIRST_GUESS["motor"], FIRST_GUESS)
        # It was planned with a guess of the speed.
        little = replace(little, size=LITTLE * little.pace["motor"] / FIRST_GUESS["motor"])
    else:
        little = _Pilot(after.size, 0.0, after.pace, {})
    free = little.pace["motor"]

    def planned(of: _Pilot) -> list[Population]:
        return circulation.populations(_by_class({**of.pace, "motor": free}), carried=of.size)

    full = _Pilot(1.0, 1.0, little.pace, {})
    most = FULLEST * room / max(_vehicles(planned(full)), 1)

    def piloted(size: float, seconds: int = PILOT_S) -> _Pilot:
        return pilot(size, free, little.pace, seconds)

    tell = progress or (lambda _: None)
    first = little.size if after else _in_minutes(little, most, piloted, tell)
    best = _in_the_long_run(first, most, lambda size: piloted(size, LONG_S), tell)
    standing = {lane: total / best.seconds for lane, total in best.queued.items()}
    carried = 1.0 if best.flow >= 1.0 - TOLERANCE else best.flow
    return Calibrated(planned(best), carried, standing, little.pace, best.size)


def _in_minutes(
    little: _Pilot,
    most: float,
    pilot: Callable[[float], _Pilot],
    progress: Callable[[float], None],
) -> float:
    """Return about what population is taken, as short pilots have it.

    Args:
        little: the pilot of little traffic.
        most: the largest population.
        pilot: runs one of a population.
        progress: called with the fraction done; the longer ones are the rest.
    """
    found, before = [little], little
    size = min(1.0, most)
    for number in range(PILOTS):
        progress(IN_MINUTES * (1 + number) / (1 + PILOTS))
        now = pilot(size)
        found.append(now)
        if abs(now.flow - 1.0) <= TOLERANCE:
            break
        gain = (now.flow - before.flow) / max(now.size - before.size, 1e-6)
        if now.flow < 1.0 and gain < WORTHWHILE * before.flow / before.size:
            # More only stand in queues: between the two, once, there may be a better one.
            if number + 1 < PILOTS and now.size > 2 * before.size:
                found.append(pilot((now.size * before.size) ** 0.5))
            break
        if now.flow < 1.0 and size >= most:
            break
        before = now
        size = min(size * min(1.0 / max(now.flow, 0.1), GROWTH), most)
    return _best(found).size


def _in_the_long_run(
    first: float,
    most: float,
    pilot: Callable[[float], _Pilot],
    progress: Callable[[float], None],
) -> _Pilot:
    """Return the longer pilot of the population that is taken.

    Args:
        first: the population to begin with.
        most: the largest.
        pilot: runs one of a population.
        progress: called with the fraction done.
    """
    held: list[_Pilot] = []
    size = first
    for number in range(LONG_PILOTS):
        progress(IN_MINUTES + (1.0 - IN_MINUTES) * number / LONG_PILOTS)
        now = pilot(size)
        if not now.flow or now.longest_halt_s >= LONGEST_HALT_S:
            most = size
            fewer = LESS if number < 2 else FAR_LESS
            size = (size * held[-1].size) ** 0.5 if held else size * fewer
        else:
            gain = (now.flow - held[-1].flow) / (now.size - held[-1].size) if held else np.inf
            held.append(now)
            if now.flow >= 1.0 - TOLERANCE or gain < WORTHWHILE * now.flow / now.size:
                break
            size = min(size * float(np.clip(1.0 / now.flow, *MORE)), most)
        if held and size < held[-1].size * MORE[0]:
            break
    if not held:
        # Streets that lock up with anybody: so few bring that much as long as they do not.
        return replace(now, size=size, flow=size)
    best = _best(held)
    # More than was asked for: there are fewer.
    return replace(best, size=best.size / max(best.flow, 1.0))


def _best(found: list[_Pilot]) -> _Pilot:
    """Return the smallest population that brings what was asked for, or about the highest flow."""
    most = max(one.flow for one in found)
    wanted = 1.0 - TOLERANCE if most >= 1.0 - TOLERANCE else most - ALIKE
    return min((one for one in found if one.flow >= wanted), key=lambda one: one.size)


def _flow(populations: list[Population], seen: Observed, since_min: int) -> float:
    """Return the flow of motor vehicles as a share of what was asked for; 0 where they lock up."""
    motor = [group for group in populations if _kind(group.actor_class) == "motor"]
    asked = sum(group.per_hour for group in motor)
    if not asked:
        return 1.0
    minutes = np.zeros(len(seen.metres))
    for group in motor:
        minutes += seen.metres[:, ACTOR_CLASSES.index(group.actor_class)] / group.metres
    minutes = minutes[since_min:-1] if len(minutes) > since_min + 1 else minutes
    first, last = np.array_split(minutes, 2)
    if last.mean() < FALLS * first.mean() and seen.vehicle_halt_s > PILOT_S / 3:
        return 0.0
    return float(minutes.mean() * 60.0 / asked)


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
