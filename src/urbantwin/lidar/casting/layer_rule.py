"""When rays of a beam meet the same surface, and where its layer lies: one rule for all tracers.

Plain functions of float64 numbers: numba compiles them for the processor (`compiled.cast`), Warp
for a device (`device.cast`). What they call by name are the constants of this file.
"""

from __future__ import annotations

__all__ = [
    "BEHIND_M",
    "GRAZING",
    "MOST_PANES",
    "MOST_SURFACES",
    "ON_AXIS",
    "STEP_M",
    "is_predicted",
    "is_same_surface",
    "layer_range",
    "plane_range",
]

#: Bit of a layer's mask: the beam's axis passes through the bounds of the actor.
ON_AXIS = 1 << 7

#: Two rays meet the same surface where the plane of one's triangle predicts the other's range to
#: this, metres: what a curb, a bumper or a wheel stands out by.
SAME_SURFACE_M = 0.1
#: Ranges of neighbouring beams that differ by less are no edge, metres.
STEP_M = 0.3
#: A neighbour lies on the same surface where its plane predicts the neighbour's range to this.
_PREDICTED_M = 3 * SAME_SURFACE_M
#: The axis's range on a surface's plane counts as far as this from what its rays measured.
_ON_PLANE_M = 10 * SAME_SURFACE_M
#: A ray closer to a plane than this (sine of the angle) keeps the ray tracer's range.
GRAZING = 1e-3
#: How much farther a ray starts behind a pane, metres.
BEHIND_M = 2e-3
#: Panes of glass that a ray passes through, and surfaces that a beam may meet.
MOST_PANES = 8
MOST_SURFACES = 40

_NAN = float("nan")


def plane_range(height: float, slant: float) -> float:
    """Return where a ray meets a plane; ``nan`` where it grazes it.

    Args:
        height: of the plane over the ray's origin, along the plane's normal.
        slant: cosine between the ray and the normal.
    """
    if abs(slant) < GRAZING:
        return _NAN
    return height / slant


def is_predicted(told: float, met: float) -> bool:
    """Return whether a neighbour's range is what a plane predicts; of ``nan``, it is not."""
    return abs(told - met) < _PREDICTED_M


def is_same_surface(told: float, met: float) -> bool:
    """Return whether a ray of the footprint meets the surface whose plane predicts a range."""
    return abs(told - met) < SAME_SURFACE_M


def layer_range(told: float, mean: float, axis_meets: bool) -> float:
    """Return the range of a layer: its plane's along the axis, else the mean over its rays."""
    if axis_meets and abs(told - mean) < _ON_PLANE_M:
        return told
    return mean
