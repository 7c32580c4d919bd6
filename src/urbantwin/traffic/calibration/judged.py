"""Comparison of a simulation with the fitted and the held-out part of a recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.progress import Progress
from urbantwin.traffic.calibration.agreement import (
    agreement,
    chance_between,
    own_spread,
    spread_of,
)
from urbantwin.traffic.calibration.measured import Measured, joined
from urbantwin.traffic.calibration.on_twin import measuring, passed
from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.calibration.simulated import seen_area, simulated_tracks
from urbantwin.twin import Twin

__all__ = ["judged", "told_of"]

#: Maximum number of spans of a simulation that are compared with the whole; and approximate number
#: of spans that begin in the same part of a cycle.
_MAX_SPANS, _MAX_CYCLES = 40, 8


def judged(
    twin: Twin,
    asked: dict[str, Any],
    recorded: tuple[Measured, Callable[[float, float], Measured], list[SeenTrack]],
    rest: tuple[float, float],
    seconds: float,
    scratch: Path,
    progress: Progress,
    cycle_s: float,
) -> dict[str, Any]:
    """Return the agreement of a simulation with the fitted and the held-out part.

    If the cycle of the signals is known, also with spans in the same part of the cycle, since a
    short held-out part is no whole number of cycles.
    """
    part, recorded_between, seen = recorded
    tracks = simulated_tracks(
        twin,
        asked,
        seconds,
        seen_area(seen),
        scratch=scratch,
        told=lambda share: progress(share, "simulating what is judged"),
    )
    between_moments = measuring(twin, tracks, *passed(twin, tracks))
    simulated = between_moments(0.0, seconds)
    report: dict[str, Any] = {"simulated": told_of(simulated), "fitted": agreement(part, simulated)}
    report["recording_with_itself_fitted"] = own_spread(part)
    if rest[1] - rest[0] > 1.0:
        other = recorded_between(*rest)
        report["held_out_s"] = [round(rest[0], 3), round(rest[1], 3)]
        report["held_out"] = agreement(other, simulated)
        if cycle_s:
            # SUMO's clock, which starts with the warm-up, is that of the signals.
            first = (rest[0] - float(asked["warmup_s"])) % cycle_s
            begins = np.arange(first, seconds - (rest[1] - rest[0]), cycle_s)
            begins = begins[:: max(1, len(begins) // _MAX_CYCLES)]  # they overlap
            parts = [between_moments(begin_s, begin_s + rest[1] - rest[0]) for begin_s in begins]
            report["held_out_in_the_same_part_of_the_cycle"] = agreement(other, joined(parts))
        report["recording_with_itself_held_out"] = own_spread(other)
        begins = np.arange(0.0, seconds - (rest[1] - rest[0]), rest[1] - rest[0])[:_MAX_SPANS]
        spans = [between_moments(begin_s, begin_s + rest[1] - rest[0]) for begin_s in begins]
        report["simulation_with_itself_held_out"] = spread_of(spans, simulated)
        report["fitted_with_held_out"] = agreement(other, part)
        report["by_chance_held_out"] = chance_between(part, other)
    return report


def told_of(part: Measured) -> dict[str, Any]:
    """Return the entries of a measurement in ``calibration.json``."""
    speeds = np.concatenate(part.speeds) if part.speeds else np.zeros(0)
    return {
        "seconds": round(part.seconds, 3),
        "classes": part.classes,
        "turns": [
            {"approach": a, "exit": b, "count": count}
            for (a, b), count in sorted(part.turns.items())
        ],
        "speed_quartiles_ms": _quartiles(speeds),
        "headway_quartiles_s": _quartiles(part.all_headways),
    }


def _quartiles(values: np.ndarray[Any, Any]) -> list[float]:
    return (
        [round(float(x), 2) for x in np.quantile(values, [0.25, 0.5, 0.75])] if len(values) else []
    )
