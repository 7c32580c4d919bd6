"""Parameters that can be fitted, with their bounds and where they are written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from urbantwin.errors import InputError
from urbantwin.lidar import Rig

__all__ = ["GROUPS", "TILT_DEG", "Knob", "Values", "groups_of", "rig_knobs", "starts"]

#: Groups of ``--fit``, in the order of fitting.
GROUPS = ("pose", "reflectivity", "dropout", "noise", "actors")

#: Fitted value of each parameter by its name.
Values = Mapping[str, float]


@dataclass(frozen=True)
class Knob:
    """One uncertain parameter.

    Attributes:
        name: unique name; its path in the file.
        group: one of `GROUPS`.
        start: value before the fit.
        low: lower bound.
        high: upper bound.
        unit: unit of the three; empty for factors and shares.
        times: a factor, searched by its logarithm.
    """

    name: str
    group: str
    start: float
    low: float
    high: float
    unit: str = ""
    times: bool = False

    def at(self, share: float) -> float:
        """Return the value at a share (0..1) of the range between the bounds."""
        share = min(max(share, 0.0), 1.0)
        if self.times:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))

    def share(self, value: float) -> float:
        """Return the position of a value between the bounds, 0..1."""
        if self.times:
            found = np.log(value / self.low) / np.log(self.high / self.low)
        else:
            found = (value - self.low) / (self.high - self.low)
        return float(np.clip(found, 0.0, 1.0))


def groups_of(text: str) -> tuple[str, ...]:
    """Return the groups of a comma-separated list, in the order of `GROUPS`.

    Raises:
        InputError: an unknown group, or none.
    """
    named = {one.strip() for one in text.split(",") if one.strip()}
    for one in sorted(named - set(GROUPS)):
        raise InputError(f"{one!r:.40} cannot be fitted", place="--fit", expected=", ".join(GROUPS))
    if not named:
        raise InputError("no group is named", place="--fit", expected=", ".join(GROUPS))
    return tuple(one for one in GROUPS if one in named)


def starts(knobs: Iterable[Knob]) -> dict[str, float]:
    """Return the value of every parameter before the fit."""
    return {one.name: one.start for one in knobs}


#: Maximum change of pitch and roll, degrees.
TILT_DEG = 3.0
#: Maximum changes of the pose, metres and degrees; beyond, ``align`` finds the pose.
_MOVES = (
    *(("east", 1.5, "m"), ("north", 1.5, "m"), ("up", 0.75, "m")),
    *(("yaw", 6.0, "deg"), ("pitch", TILT_DEG, "deg"), ("roll", TILT_DEG, "deg")),
)


def rig_knobs(
    rig: Rig, group: str, materials: Iterable[str] = (), *, has_intensity: bool = True
) -> list[Knob]:
    """Return the parameters of a rig in one group.

    Args:
        rig: the rig as written.
        group: one of `GROUPS`.
        materials: names of the materials that its beams hit.
        has_intensity: whether the real frames have intensity.
    """
    knobs: list[Knob] = []
    if group == "pose":
        knobs += [
            Knob(f"move.{name}_{unit}", group, 0.0, -reach, reach, unit)
            for name, reach, unit in _MOVES
        ]
    for one in rig.sensors:
        unit = one.calibration
        own = f"sensors.{one.name}.calibration"
        if group == "pose":
            start = unit.range_offset_m
            low, high = max(start - 0.3, -1.0), min(start + 0.3, 1.0)
            knobs.append(Knob(f"{own}.range_offset_m", group, start, low, high, "m"))
        elif group == "noise":
            knobs.append(_factor(f"{own}.range_noise", group, unit.range_noise))
        elif group == "dropout":
            knobs.append(_factor(f"{own}.light", group, unit.light))
            high = min(1.0, max(0.5, 2 * unit.missing))
            knobs.append(Knob(f"{own}.missing", group, unit.missing, 0.0, high))
        elif group == "reflectivity" and has_intensity:
            knobs.append(_factor(f"{own}.intensity", group, unit.intensity))
    if group == "reflectivity" and has_intensity:
        given = rig.sensors[0].reflectivity
        knobs += [
            _factor(f"reflectivity.{name}", group, given.get(name, 1.0)) for name in materials
        ]
    return knobs


def _factor(name: str, group: str, start: float) -> Knob:
    """Return the parameter of a factor, from a fifth to five times its start."""
    middle = max(start, 0.05)
    return Knob(name, group, start, max(0.2 * middle, 0.01), min(5.0 * middle, 10.0), times=True)
