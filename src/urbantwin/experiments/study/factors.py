"""What a study of robustness varies: faults of sensors, the weather, how much traffic there is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from urbantwin.experiments.grid import Axis, Level
from urbantwin.site import RigSpec

__all__ = ["FACTORS", "NONE", "Factor", "FactorAsked", "by_clock", "first_problem", "rig_at"]

#: Changes a written rig: with the level, and the factor as it was asked for.
Change = Callable[[dict[str, Any], Any, "FactorAsked"], None]

#: The level of a fault or of weather that is not there.
NONE = "none"


@dataclass(frozen=True)
class Factor:
    """Something that can be varied.

    Attributes:
        name: as it stands in a study's file, with its unit.
        told: what it is, in words.
        change: changes the rig; ``None``: it is no matter of the rig.
        low: the least level.
        high: the greatest.
        none: whether `NONE` is a level, too.
        names_sensor: whether its levels are names of sensors.
        by_clock: whether frames must be collected by the sensors' clocks for it to do anything.
        first_sensor: whether it is of the rig's first sensor where nobody says of which; else all.
    """

    name: str
    told: str
    change: Change | None
    low: float = 0.0
    high: float = 1.0
    none: bool = False
    names_sensor: bool = False
    by_clock: bool = False
    first_sensor: bool = False

    @property
    def expected(self) -> str:
        """What a level may be."""
        if self.names_sensor:
            return f"the name of a sensor, or {NONE}"
        return f"{self.low:g} to {self.high:g}" + (f", or {NONE}" if self.none else "")

    def allows(self, level: Level, sensors: Sequence[str]) -> bool:
        """Return whether it can have a level, in a rig of such sensors."""
        if isinstance(level, str):
            return (level == NONE and self.none) or (self.names_sensor and level in sensors)
        return not self.names_sensor and self.low <= level <= self.high


@dataclass(frozen=True)
class FactorAsked:
    """A factor as a study asks for it.

    Attributes:
        axis: its name and levels.
        sensors: of which sensors; all, or the first where that is its way, if empty.
        set_before_s: how long before the motion's start the clocks were set, of clocks that drift.
        memory_s: of poses that wander, see `PoseErrorSpec`.
    """

    axis: Axis
    sensors: tuple[str, ...] = ()
    set_before_s: float = 3600.0
    memory_s: float = 60.0

    @property
    def factor(self) -> Factor:
        """What it is."""
        return FACTORS[self.axis.name]

    def chosen(self, rig: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return the sensors of a written rig that it is of."""
        rows: list[dict[str, Any]] = rig["sensors"]
        if self.sensors:
            return [one for one in rows if one["name"] in self.sensors]
        return rows[:1] if self.factor.first_sensor else rows


def rig_at(spec: RigSpec, asked: Sequence[FactorAsked], levels: Mapping[str, Level]) -> RigSpec:
    """Return a rig with every factor at its level.

    Args:
        spec: without them.
        asked: the factors of the study.
        levels: of each.

    Raises:
        ValueError: the rig cannot have a level (pydantic's ``ValidationError``), or two weathers.
    """
    rig = spec.written()
    if by_clock(asked):
        rig["frames_by"] = "clock"
    for one in asked:
        if one.factor.change is not None:
            one.factor.change(rig, levels[one.axis.name], one)
    return RigSpec.model_validate(rig, strict=True)


def first_problem(error: ValueError) -> str:
    """Return what `rig_at` found wrong: of pydantic's error its first problem."""
    lines = str(error).splitlines()
    problem = lines[2] if len(lines) > 2 else lines[0]
    return problem.partition(" [type=")[0].strip()[:160]


def by_clock(asked: Sequence[FactorAsked]) -> bool:
    """Return whether all frames of a study are collected by clocks, the base's, too."""
    return any(one.factor.by_clock for one in asked)


def _each(change: Callable[[dict[str, Any], Any, FactorAsked], object]) -> Change:
    """Return what makes a change to every chosen sensor of a rig."""

    def change_rig(rig: dict[str, Any], level: Level, asked: FactorAsked) -> None:
        for sensor in asked.chosen(rig):
            change(sensor, level, asked)

    return change_rig


def _set(name: str) -> Change:
    return _each(lambda sensor, level, _: sensor.update({name: float(level)}))


def _calibrate(name: str, changed: Callable[[dict[str, Any], float], float]) -> Change:
    def change(sensor: dict[str, Any], level: float, _: FactorAsked) -> None:
        usual = sensor.setdefault("calibration", {})
        usual[name] = changed(usual, level)

    return _each(change)


def _pose(name: str) -> Change:
    def change(sensor: dict[str, Any], level: float, asked: FactorAsked) -> None:
        sensor.setdefault("pose_error", {"memory_s": asked.memory_s})[name] = float(level)

    return _each(change)


def _clock(rig: dict[str, Any], ahead_s: float, drift_ppm: float, asked: FactorAsked) -> None:
    """Let the clocks of chosen sensors be ahead and behind in turn: they part from each other."""
    for number, sensor in enumerate(asked.chosen(rig)):
        sign = -1.0 if number % 2 else 1.0
        sensor["clock_offset_s"] = sensor.get("clock_offset_s", 0.0) + sign * ahead_s
        sensor["clock_drift_ppm"] = sensor.get("clock_drift_ppm", 0.0) + sign * drift_ppm


def _offset(rig: dict[str, Any], level: float, asked: FactorAsked) -> None:
    _clock(rig, float(level), 0.0, asked)


def _drift(rig: dict[str, Any], level: float, asked: FactorAsked) -> None:
    _clock(rig, level * 1e-6 * asked.set_before_s, float(level), asked)


def _sway(rig: dict[str, Any], level: float, asked: FactorAsked) -> None:
    for sensor in asked.chosen(rig):
        usual = sensor.get("sway") or rig.get("sway") or {}
        sensor["sway"] = {**usual, "rms_m": float(level)}


def _sector(sensor: dict[str, Any], level: float, _: FactorAsked) -> None:
    """Blind a sector about the sensor's forward axis."""
    if level > 0:
        half = min(level / 2, 180.0)
        outage = {} if level >= 360 else {"sector_deg": [-half, half]}
        sensor.setdefault("outages", []).append(outage)


def _unit(rig: dict[str, Any], level: str, _: FactorAsked) -> None:
    for sensor in rig["sensors"]:
        if sensor["name"] == level:
            sensor.setdefault("outages", []).append({})


def _weather(name: str) -> Factor:
    def change(rig: dict[str, Any], level: float | str, _: FactorAsked) -> None:
        if level == NONE:
            return
        conditions = rig["conditions"]
        if conditions["weather"] not in ("clear", name):
            raise ValueError(f"{name} and {conditions['weather']} at once")
        conditions |= {"weather": name, "visibility_m": float(level)}

    words = f"how far one sees in {name}, metres"
    return Factor(f"{name}_visibility_m", words, change, low=10.0, high=100_000.0, none=True)


#: All factors by name.
FACTORS: dict[str, Factor] = {
    factor.name: factor
    for factor in (
        Factor("sync_jitter_s", "standard deviation of when a turn begins", _set("time_jitter_s")),
        Factor("clock_offset_s", "how far the sensors' clocks are off, ahead and behind in turn",
               _offset, high=10.0, by_clock=True),
        Factor("clock_drift_ppm",
               "how fast the sensors' clocks run off, too fast and too slow in turn",
               _drift, high=10_000.0, by_clock=True),
        Factor("latency_s", "how late data are", _set("latency_s"), first_sensor=True),
        Factor("dropped_frames", "share of turns that are lost", _set("dropped_frames")),
        Factor("pose_error_m", "how far off poses are reported, each axis", _pose("rms_m"),
               high=10.0),
        Factor("pose_error_deg", "how far turned poses are reported", _pose("rms_deg"), high=30.0),
        Factor("pose_drift_m_per_min", "how fast reported places go off",
               _pose("drift_m_per_min"), high=60.0),
        Factor("pose_drift_deg_per_min", "how fast reported attitudes go off",
               _pose("drift_deg_per_min"), high=360.0),
        Factor("sway_m", "how far poles sway, root mean square", _sway),
        Factor("outage_sector_deg", "width of a blind sector ahead of a sensor", _each(_sector),
               high=360.0, first_sensor=True),
        Factor("outage_unit", "a sensor that is out", _unit, none=True, names_sensor=True),
        *map(_weather, ("rain", "fog", "snow")),
        Factor("dirt_light", "share of light that dirt on windows lets pass",
               _calibrate("light", lambda usual, light: max(0.01, usual.get("light", 1.0) * light)),
               low=0.01),
        Factor("missing", "share of beams that return nothing",
               _calibrate("missing", lambda _, share: float(share))),
        Factor("traffic_density", "times the site's traffic", None, low=0.05, high=10.0),
    )
}  # fmt: skip
