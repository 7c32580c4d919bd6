"""Training drives for a site-specific detector, with varied traffic, weather and sensor pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from urbantwin.site.rig import RigSpec
from urbantwin.site.rig_changes import RigChanges

__all__ = ["Lesson", "lessons_of", "moved_rig"]

#: Times of day of training drives, in turn; below, times of day of evaluation drives.
_HOURS = ("08:00", "12:30", "17:15", "10:30", "15:00", "20:00")
_OTHER_HOURS = ("09:15", "18:30", "13:45")
#: Range of the factor on all traffic; rare classes are multiplied further, up to this.
_DENSITY, _MORE = (0.6, 1.5), 3.0
_RARE = ("truck", "bus", "motorcycle", "bicycle", "pedestrian")
#: Every n-th drive has rain, fog or snow; below, ranges of the visibility then, metres.
_BAD_WEATHER = 4
_VISIBILITY_M = {"rain": (500.0, 3000.0), "fog": (150.0, 500.0), "snow": (400.0, 2000.0)}
#: Fields that give the position of a sensor; each sensor uses three of them.
_LENGTHS = ("east_m", "north_m", "forward_m", "left_m", "height_m", "up_m", "altitude_m")


@dataclass(frozen=True)
class Lesson:
    """One drive.

    Attributes:
        name: name of its folder.
        held: whether the drive is for evaluation; otherwise it is for training.
        seed: seed of all random choices in it.
        time_of_day: start time.
        demand: factor on the site's traffic, by class.
        weather: clear, rain, fog or snow.
        visibility_m: visibility, metres; ``None``: as in clear air.
        wet_ground: wetness of the ground, 0 to 1.
        sun_elevation_deg: elevation of the sun.
    """

    name: str
    held: bool
    seed: int
    time_of_day: str
    demand: Mapping[str, float]
    weather: str
    visibility_m: float | None
    wet_ground: float
    sun_elevation_deg: float

    def per_hour(self, usual: Mapping[str, float]) -> dict[str, float]:
        """Return the demand (actors per hour by class), from the site's normal demand."""
        return {name: round(rate * self.demand.get(name, 1.0), 1) for name, rate in usual.items()}

    def conditions(self) -> RigChanges:
        """Return weather and light as changes to a rig."""
        return RigChanges(
            weather=self.weather,
            visibility_m=self.visibility_m,
            wet_ground=self.wet_ground,
            sun_elevation_deg=self.sun_elevation_deg,
            fused=True,
        )


def lessons_of(teaching: int, judging: int, seed: int) -> tuple[Lesson, ...]:
    """Return the drives of a course; evaluation drives come last.

    Evaluation drives have different seeds (odd numbers) and start times, normal demand and clear
    air.

    Args:
        teaching: number of training drives.
        judging: number of evaluation drives.
        seed: seed of every random choice.
    """
    found = []
    for number in range(teaching):
        draw = np.random.default_rng([seed, number])
        density = float(np.exp(draw.uniform(*np.log(_DENSITY))))
        demand = {"car": density}
        demand |= {name: density * float(draw.uniform(1.0, _MORE)) for name in _RARE}
        weather, visibility, wet = "clear", None, 0.0
        if number % _BAD_WEATHER == _BAD_WEATHER - 1:
            weather = "rain" if number % (2 * _BAD_WEATHER) < _BAD_WEATHER else "fog"
            weather = "snow" if number % (4 * _BAD_WEATHER) == 4 * _BAD_WEATHER - 1 else weather
            visibility = round(float(np.exp(draw.uniform(*np.log(_VISIBILITY_M[weather])))))
            wet = round(float(draw.uniform(0.5, 1.0)), 2) if weather == "rain" else 0.0
        found.append(
            Lesson(
                f"teach-{number + 1}", False, 2 * (seed * 1000 + number),
                _HOURS[number % len(_HOURS)], demand, weather, visibility, wet,
                round(float(draw.uniform(5.0, 60.0)), 1),
            )
        )  # fmt: skip
    found += [
        Lesson(
            f"judge-{number + 1}", True, 2 * (seed * 1000 + number) + 1,
            _OTHER_HOURS[number % len(_OTHER_HOURS)], {}, "clear", None, 0.0, 35.0,
        )
        for number in range(judging)
    ]  # fmt: skip
    return tuple(found)


def moved_rig(spec: RigSpec, lesson: Lesson, within_m: float, within_deg: float) -> RigSpec:
    """Return a rig with the weather of a drive and with random offsets of the sensor poses.

    Sensors of an evaluation drive keep the poses of the rig.

    Args:
        spec: the rig.
        lesson: the drive.
        within_m: maximum offset of every coordinate, metres.
        within_deg: maximum offset of every angle, degrees.
    """
    spec = lesson.conditions().applied_to(spec)
    if lesson.held:
        return spec
    draw = np.random.default_rng([lesson.seed, 7])
    sensors = []
    for one in spec.sensors:
        off = draw.uniform(-1.0, 1.0, 6)
        lengths = [name for name in _LENGTHS if getattr(one, name) is not None]
        moved = {name: getattr(one, name) + within_m * off[k] for k, name in enumerate(lengths[:3])}
        moved |= {
            name: getattr(one, name) + within_deg * off[3 + k]
            for k, name in enumerate(("yaw_deg", "pitch_deg", "roll_deg"))
        }
        sensors.append(one.model_copy(update=moved))
    return spec.model_copy(update={"sensors": sensors})
