"""A fit as JSON, and its summary."""

from __future__ import annotations

from typing import Any

import numpy as np

from urbantwin.fidelity.tuning.fit import RigFit
from urbantwin.fidelity.tuning.frames import Split
from urbantwin.fidelity.tuning.group_fit import GroupFit
from urbantwin.fidelity.tuning.knobs import Knob

__all__ = ["fit_as_json", "split_as_json", "summary_of"]

_SHOWN = ("hausdorff_p95_m", "js_mean", "point_to_mesh_mean_m", "chamfer_m")


def summary_of(found: dict[str, Any]) -> dict[str, Any]:
    """Return the summary of a result of ``tune``, as printed."""
    held = found["held_out"]
    knobs = {}
    for name, one in found["knobs"].items():
        unit = f" {one['unit']}" if one["unit"] in ("m", "deg") else ""
        text = f"{one['start']:.4g} -> {one['value']:.4g}{unit}"
        knobs[name] = text if one["state"] == "fitted" else one["state"]
    measures = held.get("measures", {})
    return {
        "frames": {name: span for name, span in found["split"].items() if span},
        "knobs": knobs,
        "held_out": {
            name: f"{one['start']:.4g} -> {one['tuned']:.4g}, {one['verdict']}"
            for name, one in held.get("groups", {}).items()
        },
        "measures": {
            name: " -> ".join(
                "–" if measures[name][side] is None else f"{measures[name][side]:.3g}"
                for side in ("start", "tuned")
            )
            for name in _SHOWN
            if name in measures
        },
        "warnings": held.get("warnings", []),
        "notes": found["notes"],
        "problems": [*found["problems"], *held["problems"]],
    }


def split_as_json(split: Split) -> dict[str, Any]:
    """Return the first and last frame of every part, numbered from 0; ``null`` for empty parts."""
    parts = {
        "training": split.training,
        "validation": split.validation,
        "gap": split.gap,
        "held_out": split.held_out,
    }
    return {name: [part[0], part[-1]] if part else None for name, part in parts.items()}


def fit_as_json(fit: RigFit) -> dict[str, Any]:
    """Return the parameters and the groups of a fit."""
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
        # the error of a factor is multiplicative
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
