"""Views: a model at a mount's height with yaw and tilt; and costs of layouts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import place_rig
from urbantwin.lidar.rig import MountedSensor, Rig
from urbantwin.site.rig import RigSpec, SensorSpec
from urbantwin.studies.placement.mount import Mount
from urbantwin.studies.placement.place_file import PlaceSpec

__all__ = ["Layout", "View", "Views"]

#: The numbers of the views of a layout, ascending.
Layout = tuple[int, ...]


@dataclass(frozen=True)
class View:
    """A possible sensor.

    Attributes:
        mount: index of its mount.
        height_m: height above the ground, metres.
        yaw_deg: yaw relative to the junction's centre, degrees counter-clockwise.
        tilt_deg: downward pitch, degrees.
        model: index of its model.
    """

    mount: int
    height_m: float
    yaw_deg: float
    tilt_deg: float
    model: int


@dataclass(frozen=True, eq=False)
class Views:
    """All views that can be chosen.

    Attributes:
        spec: settings of the search.
        mounts: candidate places of sensors.
        file: ``place.yaml``, whose folder may contain sensor files; ``None`` without one.
    """

    spec: PlaceSpec
    mounts: tuple[Mount, ...]
    file: Path | None = None

    @cached_property
    def every(self) -> tuple[View, ...]:
        """All views, in the order of mounts, heights, models, tilts and yaws.

        A rotating sensor without tilt has a single yaw, since all are equivalent.
        """
        return tuple(
            View(number, height_m, yaw_deg, tilt_deg, model)
            for number, mount in enumerate(self.mounts)
            for height_m in mount.heights_m
            for model in range(len(self.spec.models))
            for tilt_deg in dict.fromkeys(self.spec.tilt_deg)
            for yaw_deg in self.yaws(tilt_deg, model)
        )

    @cached_property
    def number_of(self) -> dict[View, int]:
        """The number of each view."""
        return {view: number for number, view in enumerate(self.every)}

    @cached_property
    def _turning(self) -> tuple[bool, ...]:
        """Whether each model has a full rotation."""
        return tuple(one.pattern is None for one in self.spec.sensors_of_models(self.file))

    def yaws(self, tilt_deg: float, model: int) -> tuple[float, ...]:
        """Return the yaws, degrees, that make a difference."""
        if tilt_deg == 0 and self._turning[model]:
            return (self.spec.yaw_deg[0],)
        return tuple(dict.fromkeys(self.spec.yaw_deg))

    def chosen(self, mount: int, height: int, model: int, tilt: int, yaw: int) -> int:
        """Return the index of a view given by choices, each modulo the number of options."""
        heights = self.mounts[mount].heights_m
        tilt_deg = self.spec.tilt_deg[tilt]
        yaws = self.yaws(tilt_deg, model)
        return self.number_of[
            View(mount, heights[height % len(heights)], yaws[yaw % len(yaws)], tilt_deg, model)
        ]

    def cost(self, layout: Layout) -> float:
        """Return the cost of a layout."""
        views = [self.every[number] for number in layout]
        poles = {one.mount for one in views if self.mounts[one.mount].kind == "new-pole"}
        costs = self.spec.costs
        sensors = sum(self.spec.models[one.model].price for one in views)
        return sensors + len(views) * costs.bracket + len(poles) * costs.new_pole

    def cheapest(self) -> Layout:
        """Return a layout with the least cost; a new pole may carry several sensors.

        There must be room for ``sensors.least`` sensors.
        """
        model = min(range(len(self.spec.models)), key=lambda k: self.spec.models[k].price)
        tilt_deg = self.spec.tilt_deg[0]
        yaw_deg = self.yaws(tilt_deg, model)[0]

        def expense(number: int) -> tuple[bool, int]:
            mount = self.mounts[number]
            return mount.kind == "new-pole", -len(mount.heights_m)

        rooms = (
            View(number, height_m, yaw_deg, tilt_deg, model)
            for number in sorted(range(len(self.mounts)), key=expense)
            for height_m in self.mounts[number].heights_m
        )
        return tuple(
            sorted(self.number_of[view] for view in islice(rooms, self.spec.sensors.least))
        )

    def fits(self, layout: Sequence[int]) -> bool:
        """Return whether no two sensors have the same height at a mount."""
        hung = [(self.every[n].mount, self.every[n].height_m) for n in layout]
        return len(set(hung)) == len(hung)

    def sensor_spec(self, number: int, name: str) -> SensorSpec:
        """Return a view as a sensor of a rig's file."""
        view = self.every[number]
        mount, model = self.mounts[view.mount], self.spec.models[view.model]
        yaw = (np.degrees(mount.toward) + view.yaw_deg + 180.0) % 360.0 - 180.0
        return SensorSpec(
            name=name,
            model=model.model,
            columns=model.columns,
            east_m=mount.east_m,
            north_m=mount.north_m,
            height_m=view.height_m,
            yaw_deg=round(float(yaw), 2),
            pitch_deg=view.tilt_deg,
        )

    def rig_spec(self, layout: Layout, reflectivity: dict[str, float] | None = None) -> RigSpec:
        """Return the rig of a layout."""
        return RigSpec(
            rate_hz=self.spec.rate_hz,
            frame="site",
            conditions=self.spec.conditions,
            reflectivity=reflectivity or {},
            sensors=[self.sensor_spec(n, f"sensor-{k + 1}") for k, n in enumerate(layout)],
        )

    def models(self, mesh: LabelledMesh, reflectivity: dict[str, float]) -> Rig:
        """Return a rig with a sensor of each model, mounted somewhere on the twin.

        Raises:
            InputError: a model does not offer the requested columns.
        """
        models = range(len(self.spec.models))
        first = [next(n for n, one in enumerate(self.every) if one.model == k) for k in models]
        rig = self.rig_spec(tuple(first), reflectivity)
        try:
            return place_rig(rig, mesh, file=self.file)
        except InputError as error:
            if error.place is None or not error.place.startswith("sensors["):
                raise
            place = error.place.replace("sensors[", "models[")
            raise InputError(
                error.problem, file=self.file, place=place, expected=error.expected
            ) from None

    def hung(self, number: int, models: Sequence[MountedSensor]) -> MountedSensor:
        """Return a view's sensor at its pose, derived from the sensor of its model."""
        view = self.every[number]
        spec = self.sensor_spec(number, f"view-{number}")
        place = self.mounts[view.mount].place(view.height_m)
        pose = Pose.from_ypr(place, *np.radians([spec.yaw_deg, spec.pitch_deg, spec.roll_deg]))
        return replace(
            models[view.model],
            name=spec.name,
            site_SE3_sensor=pose,
            number=0,
            swings_with=0,
            sway_height_m=view.height_m,
        )
