"""A fit as JSON: every knob's start, fitted value and standard error."""

from __future__ import annotations

from typing import Any

import numpy as np

from urbantwin.fidelity.tuning.fit import RigFit
from urbantwin.fidelity.tuning.group_fit import GroupFit
from urbantwin.fidelity.tuning.knobs import Knob
from urbantwin.fidelity.tuning.split import Split

__all__ = ["fit_as_json", "split_as_json"]


def split_as_json(split: Split) -> dict[str, Any]:
    """Return the first and the last frame of every part, numbered from 0; none: ``null``."""
    parts = {
        "training": split.training,
        "validation": split.validation,
        "gap": split.gap,
        "held_out": split.held_out,
    }
    return {name: [part[0], part[-1]] if part else None for name, part in parts.items()}


def fit_as_json(fit: RigFit) -> dict[str, Any]:
    """Return the knobs and the groups of a fit."""
    by_knob = {name: one for one in fit.groups for name in one.values}
    return {
        "knobs": {one.name: _knob(one, by_knob[one.name]) for one in fit.knobs},
        "groups": {
            one.name: {
                "loss": {
                    part: {"start": _short(a), "tuned": _short(b)}
                    for part, (a, b) in one.losses.items()
                },
                "history": [_short(loss) for loss in one.history],
            }
            for one in fit.groups
        },
    }


def _knob(one: Knob, group: GroupFit) -> dict[str, Any]:
    share = group.sharp[one.name]
    value = group.values[one.name]
    known = None
    if np.isfinite(share):
        # A factor's error is that of its logarithm: times or divided by this.
        known = np.exp(share * np.log(one.high / one.low)) if one.times else None
        known = share * (one.high - one.low) if known is None else known
    return {
        "group": group.name,
        "start": _short(one.start),
        "value": _short(value),
        "unit": one.unit or ("factor" if one.times else "share"),
        "bounds": [_short(one.low), _short(one.high)],
        "standard_error_factor" if one.times else "standard_error": (
            None if known is None else _short(float(known))
        ),
        "state": group.state[one.name],
    }


def _short(value: float) -> float:
    return float(f"{value:.6g}")
