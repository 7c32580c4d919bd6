"""Factors of robustness studies: sensor faults, weather, traffic density."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from urbantwin.experiments.grid import Axis, Level
from urbantwin.site import RigSpec

__all__ = ["FACTORS", "NONE", "Factor", "FactorAsked", "by_clock", "first_problem", "rig_at"]

#: Function that changes a written rig, given the level and the requested factor.
Change = Callable[[dict[str, Any], Any, "FactorAsked"], None]

#: Level without fault or weather.
NONE = "none"


@dataclass(frozen=True)
class Factor:
    """A factor that can be varied.

    Attributes:
        name: name in a study's file, with unit.
        told: description.
        change: changes the rig; ``None`` if not a property of the rig.
        low: smallest level.
        high: largest level.
        none: whether `NONE` is also a level.
        names_sensor: whether levels are names of sensors.
        by_clock: whether it requires that frames are assembled by the sensors' clocks.
        first_sensor: whether it applies to the rig's first sensor by default, otherwise to all.
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
        """Allowed levels, in words."""
        if self.names_sensor:
            return f"the name of a sensor, or {NONE}"
        return f"{self.low:g} to {self.high:g}" + (f", or {NONE}" if self.none else "")

    def allows(self, level: Level, sensors: Sequence[str]) -> bool:
        """Return whether a level is allowed in a rig with these sensors."""
        if isinstance(level, str):
            return (level == NONE and self.none) or (self.names_sensor and level in sensors)
        return not self.names_sensor and self.low <= level <= self.high


@dataclass(frozen=True)
class FactorAsked:
    """A factor requested by a study.

    Attributes:
        axis: its name and levels.
        sensors: names of the affected sensors; the default ones if empty.
        set_before_s: time from setting the clocks to the motion's start, for drifting clocks,
            seconds.
        memory_s: correlation time of wandering poses, see `PoseErrorSpec`, seconds.
    """

    axis: Axis
    sensors: tuple[str, ...] = ()
    set_before_s: float = 3600.0
    memory_s: float = 60.0

    @property
    def factor(self) -> Factor:
        """The factor's definition."""
        return FACTORS[self.axis.name]

    def chosen(self, rig: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return the affected sensors of a written rig."""
        rows: list[dict[str, Any]] = rig["sensors"]
        if self.sensors:
            return [one for one in rows if one["name"] in self.sensors]
        return rows[:1] if self.factor.first_sensor else rows


def rig_at(spec: RigSpec, asked: Sequence[FactorAsked], levels: Mapping[str, Level]) -> RigSpec:
    """Return a rig with every factor at its level.

    Args:
        spec: the rig without factors.
        asked: the factors of the study.
        levels: level of each factor.

    Raises:
        ValueError: the rig does not allow a level (pydantic's ``ValidationError``), or has two
            weathers.
    """
    rig = spec.written()
    if by_clock(asked):
        rig["frames_by"] = "clock"
    for one in asked:
        if one.factor.change is not None:
            one.factor.change(rig, levels[one.axis.name], one)
    return RigSpec.model_validate(rig, strict=True)


def first_problem(error: ValueError) -> str:
    """Return the first problem in an error of `rig_at`."""
    lines = str(error).splitlines()
    problem = lines[2] if len(lines) > 2 else lines[0]
    return problem.partition(" [type=")[0].strip()[:160]


def by_clock(asked: Sequence[FactorAsked]) -> bool:
    """Return whether all frames of a study, including the base's, are assembled by clocks."""
    return any(one.factor.by_clock for one in asked)


def _each(change: Callable[[dict[str, Any], Any, FactorAsked], object]) -> Change:
    """Return a function that applies a change to every affected sensor of a rig."""

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
    """Set the clocks of affected sensors alternately ahead and behind."""
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
