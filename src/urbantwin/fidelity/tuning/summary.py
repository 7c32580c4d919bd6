"""The summary of a tuning, for people."""

from __future__ import annotations

from typing import Any

__all__ = ["summary_of"]

_SHOWN = ("hausdorff_p95_m", "js_mean", "point_to_mesh_mean_m", "chamfer_m")


def summary_of(found: dict[str, Any]) -> dict[str, Any]:
    """Return what ``tune`` prints of what it returns."""
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
