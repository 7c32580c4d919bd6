"""What a sensor answers to an actor along a beam if nothing stands before it."""

import numpy as np

from urbantwin.geometry.compiled import per_ray
from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.lidar.compiled.response import level_of, shown_of, strength_of

__all__ = ["answer_alone", "count_returns"]


@per_ray
def answer_alone(r, lone, echoes, both, out):
    """Write what a sensor answers to echoes of actors alone, and return to how many.

    Beams that report what is behind an actor are left out: they are not the actor's.

    Args:
        r: `response.Response`.
        lone: `compiled.echoes.AloneEchoes`, L of them.
        echoes: `echoes.Echoes` of the same beams, with all that they meet.
        both: whether the second echo is reported too; else it only stands in for a missed one.
        out: `echoes.Alone` to write, (L,).
    """
    light = np.float32(r.light)
    used = 0
    for n in range(len(lone.beam)):
        m, actor = lone.beam[n], lone.actor[n]
        amplitude, range_m = lone.amplitude[n], lone.range_m[n]
        first = echoes.first[m]
        reports = _is_of(actor, first, echoes) or (both and _is_of(actor, echoes.second[m], echoes))
        if first >= 0 and echoes.range_m[first] > range_m and not reports:
            continue
        out.beam[used], out.actor[used] = echoes.beam[m], actor
        # Mostly that is the echo which is reported, and answered already.
        if (
            first >= 0
            and echoes.owner[first] == actor
            and echoes.range_m[first] == range_m
            and echoes.amplitude[first] == amplitude
        ):
            out.level[used] = echoes.level[first]
        else:
            strength = strength_of(r, amplitude, range_m, light)
            out.level[used] = level_of(r, shown_of(r, amplitude, strength), range_m)
        used += 1
    return used


@per_ray
def _is_of(actor, echo, echoes):
    """Return whether an echo, -1 for none, is of an actor."""
    return echo >= 0 and echoes.owner[echo] >= 0 and echoes.owner[echo] % BESIDE == actor


@per_ray
def count_returns(alone, draws, counts):
    """Count how many returns each actor would give if it were alone in the world.

    Args:
        alone: `echoes.Alone`.
        draws: `returns.draws.TurnDraws`.
        counts: (A,) int64, to add to.
    """
    detection, dead = draws.first.detection, draws.dead
    for n in range(len(alone.beam)):
        beam = alone.beam[n]
        if detection[beam] < alone.level[n] and not (len(dead) and dead[beam]):
            counts[alone.actor[n]] += 1
