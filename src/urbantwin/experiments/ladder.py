"""Ladders of curricula: grades from few, near, visible objects to many, far, occluded ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
import shapely
from pydantic import Field, ValidationInfo, field_validator, model_validator

from urbantwin.errors import InputError
from urbantwin.experiments.fields import Duration, ExperimentFile, NamedFile, Time, document_of
from urbantwin.lidar import Rig
from urbantwin.site import RigSpec
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import nearest, wrong
from urbantwin.traffic import Motion

__all__ = [
    "LADDERS",
    "CurriculumFile",
    "Grade",
    "graded_rig",
    "refuse_nobody",
    "traffic_of_density",
]

#: Lowest height to which sensors are lowered, metres.
_LOWEST_M = 2.0


class Grade(Strict):
    """A grade.

    Attributes:
        name: name of its folder.
        density: factor on the site's traffic, for every class.
        raised_m: increase of the sensors' height over the rig's, metres: higher sensors see more.
        range_m: largest distance of labels that count from the nearest sensor, metres; the sensors'
            range if not given.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    density: Annotated[float, Field(gt=0.0, le=10.0)] = 1.0
    raised_m: Annotated[float, Field(ge=-20.0, le=20.0)] = 0.0
    range_m: Annotated[float, Field(ge=1.0, le=1000.0)] | None = None


#: Ladders by name: all three axes together, or a single one.
LADDERS: dict[str, tuple[Grade, ...]] = {
    "all": (
        Grade(name="1-sparse-near", density=0.25, raised_m=2.0, range_m=25.0),
        Grade(name="2-light", density=0.5, raised_m=1.0, range_m=40.0),
        Grade(name="3-usual", density=1.0, raised_m=0.0, range_m=60.0),
        Grade(name="4-dense-far", density=1.5, raised_m=-1.5),
    ),
    "density": tuple(
        Grade(name=f"density-{share:g}", density=share) for share in (0.25, 0.5, 1.0, 1.5)
    ),
    "occlusion": (
        Grade(name="raised-3m", raised_m=3.0),
        Grade(name="raised-1.5m", raised_m=1.5),
        Grade(name="as-it-is"),
        Grade(name="lowered-1.5m", raised_m=-1.5),
    ),
    "range": (
        *(Grade(name=f"range-{metres:g}m", range_m=metres) for metres in (20.0, 40.0, 60.0)),
        Grade(name="range-all"),
    ),
}


class CurriculumFile(ExperimentFile):
    """A curriculum.

    Attributes:
        twin: the twin's folder.
        rig: the rig's file; ``None`` for the twin's own.
        ladder: name of the ladder; ``own`` for given grades.
        grades: the grades, in order of ascending difficulty.
        seconds: length of each motion, seconds; ``None`` for the site's.
        start: earliest time of a frame, seconds of the motion.
        stop: latest time of a frame, seconds; ``None`` for the motion's end.
        seed: random seed; ``None`` for the site's.
    """

    described_as: ClassVar[str] = "a curriculum"

    twin: NamedFile
    rig: NamedFile | None = None
    ladder: str = "own"
    grades: Annotated[list[Grade], Field(min_length=1, max_length=50)] = Field(default_factory=list)
    seconds: Duration | None = None
    start: Time = 0.0
    stop: Time | None = None
    seed: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _with_grades(cls, fields: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        """Insert the grades of the named ladder."""
        document, ladder = document_of(info), fields.get("ladder")
        if (ladder is None) == (fields.get("grades") is None):
            raise document.error("needs a ladder or grades", [], "one of the two")
        if not isinstance(ladder, str):
            return fields
        if ladder not in LADDERS:
            expected = nearest(ladder, list(LADDERS))
            raise document.error(f"there is no ladder {ladder!r:.60}", ["ladder"], expected)
        return {**fields, "grades": list(LADDERS[ladder])}

    @field_validator("grades")
    @classmethod
    def _named_once(cls, grades: list[Grade]) -> list[Grade]:
        if len({grade.name for grade in grades}) < len(grades):
            raise wrong("names a grade twice", "each name once")
        return grades


def graded_rig(spec: RigSpec, grade: Grade) -> RigSpec:
    """Return a rig with a grade's height and label range."""
    sensors = []
    for one in spec.sensors:
        height = one.height_m
        if height is not None and grade.raised_m and not one.rides:
            height = max(height + grade.raised_m, min(height, _LOWEST_M))
        sensors.append(one.model_copy(update={"height_m": height}))
    reach = grade.range_m if grade.range_m is not None else spec.label_range_m
    return spec.model_copy(update={"sensors": sensors, "label_range_m": reach})


def traffic_of_density(traffic: Mapping[str, Any], density: float, place: str) -> dict[str, Any]:
    """Return the traffic settings that scale the site's traffic.

    Args:
        traffic: the site's traffic.
        density: factor on the volume of every class.
        place: field with the factor, for the error.

    Raises:
        InputError: the site's traffic is counted, and the factor is not 1.
    """
    if density == 1:
        return {}
    if traffic.get("counts"):
        raise InputError(
            f"asks for {density:g} of the traffic, which the site has counted",
            place=place,
            expected="density: 1, or a site with per_hour",
        )
    usual = traffic["per_hour"]
    return {"per_hour": {name: round(density * rate, 3) for name, rate in usual.items()}}


def refuse_nobody(
    grade: Grade, rig: Rig, motion: Motion, region: shapely.Polygon, times_s: Iterable[float]
) -> None:
    """Check that a static rig has an actor in reach in some frame of a grade.

    Args:
        grade: the grade.
        rig: its rig.
        motion: its motion.
        region: region of labels, site frame.
        times_s: times of its frames, seconds.

    Raises:
        InputError: no actor is in reach.
    """
    reach = rig.label_range_m
    if reach is None:
        return
    eyes = np.array([one.site_SE3_sensor.translation[:2] for one in rig.sensors])
    shapely.prepare(region)
    nearest_m = np.inf
    for time_s in times_s:
        rows = motion.at(time_s)
        rows = rows[shapely.contains_xy(region, rows["x"], rows["y"])]
        away = np.hypot(rows["x"][:, None] - eyes[:, 0], rows["y"][:, None] - eyes[:, 1])
        nearest_m = min(nearest_m, float(away.min(initial=np.inf)))
        if nearest_m <= reach:
            return
    came = f"; the nearest comes to {nearest_m:.0f} m" if np.isfinite(nearest_m) else ""
    raise InputError(
        f"has no actor within {reach:g} m of a sensor in the frames that are recorded{came}",
        place=f"grade {grade.name}",
        expected="more frames (seconds, start, stop), or a ladder with a larger range_m",
    )
