"""Flows, turns and sizes of a site's traffic from a recording."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from urbantwin.traffic.assets import asset, asset_names
from urbantwin.traffic.calibration.elsewhere import CountedElsewhere, Spot
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import MOTORS, Passage

__all__ = ["count_rows", "traffic_of"]

_QUARTER_S = 900.0
_MIN_TRACKS = 5
#: p-value below which volumes are taken to differ.
_DIFFERENCE_P_VALUE = 0.01
_SIZE_FACTOR_LIMITS = (0.5, 2.0)
_TEMPLATE_TOLERANCE_M = 0.01


def traffic_of(
    part: Measured,
    passages: Sequence[Passage],
    sizes: dict[str, np.ndarray[Any, Any]],
    begin_s: float,
    elsewhere: CountedElsewhere | None = None,
) -> tuple[dict[str, Any], list[str]]:
    """Return fields of ``traffic:`` and notes on what could not be derived.

    Args:
        part: measurement of the part of the recording that is fitted to.
        passages: passages of the whole recording.
        sizes: class -> (N, 3) sizes of its tracks, nan for unknown.
        begin_s: begin of the part, seconds.
        elsewhere: counts beyond the main junction, in the whole recording.
    """
    untold: list[str] = []
    hours = part.seconds / 3600
    traffic: dict[str, Any] = {
        "per_hour": {name: round(count / hours, 1) for name, count in part.new.items()},
        "counts": count_rows(part.turns, passages, (begin_s, part.seconds), elsewhere),
    }
    size = {}
    for name, sizes_of_class in sizes.items():
        factors = _size(name, sizes_of_class)
        if isinstance(factors, str):
            untold.append(factors)
        else:
            size[name] = factors
    if size:
        traffic["size"] = size
    return traffic, untold


def count_rows(
    turns: Collection[tuple[str, str]],
    passages: Sequence[Passage],
    span: tuple[float, float],
    elsewhere: CountedElsewhere | None,
    classes: Collection[str] = MOTORS,
) -> list[dict[str, Any]]:
    """Return rows of counts by movement and class, by quarter of an hour.

    If there are counts elsewhere, rows of 0 are included for classes without traffic: volumes of
    routes are fitted to all rows, and would be assigned to places without one.

    Args:
        turns: used (approach, exit) of the main junction.
        passages: passages of the whole recording.
        span: begin and duration of the part that is counted, seconds.
        elsewhere: counts beyond the main junction, in the whole recording.
        classes: classes to count.
    """
    begin_s, seconds = span
    end_s = begin_s + seconds
    edges = _edges(begin_s, seconds) if _volumes_differ(passages, begin_s, seconds) else None
    times_of: dict[Spot, dict[str, np.ndarray[Any, Any]]] = {}
    for approach, leaving in sorted(turns):
        movement_passages = [
            passage
            for passage in passages
            if (passage.approach, passage.leaving) == (approach, leaving)
        ]
        times_of[("approach", approach), ("turn", leaving)] = {
            name: _passing_times(
                [passage for passage in movement_passages if passage.seen.track.actor_class == name]
            )
            for name in classes
        }
    beside = {} if elsewhere is None else elsewhere.times
    times_of |= {
        spot: {name: np.array(times.get(name, [])) for name in classes}
        for spot, times in beside.items()
    }
    rows: list[dict[str, Any]] = []
    counted: set[str] = set()
    for spot, times in times_of.items():
        for name, passed in times.items():
            in_span = passed[(passed >= begin_s) & (passed < end_s)]
            if len(in_span):
                counted.add(name)
            if not len(in_span) and not beside:
                continue
            row: dict[str, Any] = {**dict(spot), "actor_class": name}
            if edges is not None:
                row["per_quarter"] = [float(count) for count in np.histogram(in_span, edges)[0]]
            else:
                row["per_hour"] = round(float(len(in_span) / seconds * 3600), 1)
            rows.append(row)
    if elsewhere is not None and beside:
        rows += [
            {"road": road, "actor_class": name, "per_hour": 0.0}
            for road in elsewhere.empty
            for name in classes
        ]
    return [row for row in rows if row["actor_class"] in counted]


def _passing_times(passages: Sequence[Passage]) -> np.ndarray[Any, Any]:
    """Return the times of passing the stop line, or of first sight, seconds."""
    return np.array(
        [np.nan_to_num(passage.passed_s, nan=passage.seen.time_s[0]) for passage in passages]
    )


def _edges(begin_s: float, seconds: float) -> np.ndarray[Any, Any]:
    """Return the limits of the whole quarters of an hour, seconds."""
    return begin_s + _QUARTER_S * np.arange(int(seconds // _QUARTER_S) + 1)


def _volumes_differ(passages: Sequence[Passage], begin_s: float, seconds: float) -> bool:
    """Return whether volumes of quarters of an hour differ significantly.

    Otherwise one volume for the whole time is more accurate: Pearson's test, approach by approach.
    """
    edges = _edges(begin_s, seconds)
    if len(edges) < 3:
        return False
    approaches = sorted({passage.approach for passage in passages})
    table = np.array(
        [
            np.histogram(
                _passing_times([passage for passage in passages if passage.approach == name]), edges
            )[0]
            for name in approaches
        ]
    )
    table = table[table.mean(axis=1) >= _MIN_TRACKS]
    mean = table.mean(axis=1, keepdims=True)
    off = float(((table - mean) ** 2 / mean).sum())
    return bool(len(table)) and float(chi2.sf(off, table.size - len(table))) < _DIFFERENCE_P_VALUE


def _size(name: str, every: np.ndarray[Any, Any]) -> dict[str, float] | str:
    """Return size factors by the medians of a class, or the reason why there are none."""
    usual = np.array(
        [[asset(x).length, asset(x).width, asset(x).height] for x in asset_names(name)]
    )
    usual = np.median(usual, axis=0)
    is_known = np.isfinite(every).any(axis=0)
    if not is_known.any():
        return f"sizes of {name}: not recorded"
    if (
        len(every) >= _MIN_TRACKS
        and (
            np.nanmax(every[:, is_known], axis=0) - np.nanmin(every[:, is_known], axis=0)
            < _TEMPLATE_TOLERANCE_M
        ).all()
    ):
        sides = " x ".join(f"{side:.2f}" for side in every[0, is_known])
        return f"sizes of {name}: all {len(every)} are {sides} m, a template and no measurement"
    if len(every) < _MIN_TRACKS:
        return f"sizes of {name}: {len(every)} tracks are too few"
    factors = np.full(3, np.nan)
    factors[is_known] = np.nanmedian(every[:, is_known], axis=0) / usual[is_known]
    return {
        side: round(float(np.clip(factor, *_SIZE_FACTOR_LIMITS)), 3)
        for side, factor, is_side_known in zip(
            ("length", "width", "height"), factors, is_known, strict=True
        )
        if is_side_known
    }
