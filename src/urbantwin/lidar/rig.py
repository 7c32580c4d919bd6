"""A rig on its site: every sensor with its table of beams and its pose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import DownwardProbe, LabelledMesh, Pose
from urbantwin.lidar.catalogue import Sensor, sensor
from urbantwin.lidar.pattern_sensor import MOST_COLUMNS
from urbantwin.site.rig import Effects, RigSpec, SensorSpec
from urbantwin.taxonomy import semantic_id

__all__ = ["GROUND_CLASSES", "MountedSensor", "Rig", "place_rig"]

#: What a sensor's height is measured from.
GROUND_CLASSES: tuple[str, ...] = ("road", "parking", "sidewalk", "terrain", "other-ground")


@dataclass(frozen=True, eq=False)
class MountedSensor:
    """A sensor on the site.

    Attributes:
        name: unique in the rig.
        sensor: its entry in the catalogue.
        columns: firings per turn.
        site_SE3_sensor: its pose.
        effects: which imperfections it has.
        rate_hz: frames per second.
    """

    name: str
    sensor: Sensor
    columns: int
    site_SE3_sensor: Pose  # noqa: N815
    effects: Effects
    rate_hz: float = 10.0


@dataclass(frozen=True, eq=False)
class Rig:
    """The sensors that record together and the frame that their points are fused in.

    Attributes:
        sensors: in the order of the rig's file; their numbers in labels are 0, 1, 2, ...
        frame: ``sensor``: that of the first sensor; ``level``: the first sensor's position and
            heading, with z against gravity; ``site``: the site frame.
        rate_hz: frames per second.
        dataset_SE3_site: takes points of the site frame to that frame.
    """

    sensors: tuple[MountedSensor, ...]
    frame: Literal["sensor", "level", "site"]
    rate_hz: float
    dataset_SE3_site: Pose  # noqa: N815


def place_rig(spec: RigSpec, mesh: LabelledMesh, *, file: str | Path | None = None) -> Rig:
    """Stand a rig on a site.

    A sensor's height is measured from the highest ground surface (`GROUND_CLASSES`) at its
    place, so a sensor named on a bridge stands on the bridge.

    Args:
        spec: the rig as written.
        mesh: the static world, site frame.
        file: the rig's file, for errors.

    Raises:
        InputError: unknown model, columns that the model does not offer, a place without ground,
            a height that is not above it, or a place inside a building. Names file and field.
    """
    ground = mesh.select(np.isin(mesh.semantic, [semantic_id(name) for name in GROUND_CLASSES]))
    buildings = mesh.select(mesh.semantic == semantic_id("building"))
    probe = DownwardProbe(ground) if len(ground.faces) else None
    above = float(mesh.vertices[:, 2].max()) + 1.0 if len(mesh.vertices) else 0.0

    def mounted(index: int, one: SensorSpec) -> MountedSensor:
        field = f"sensors[{index}]"
        model = _model(one.model, file, f"{field}.model")
        columns = model.columns if one.columns is None else one.columns
        if model.pattern is not None:
            columns = _pattern_columns(model, one, spec.rate_hz, file, f"{field}.columns")
        elif columns not in model.columns_options:
            raise InputError(
                f"{model.name} does not offer {columns} columns",
                file=file,
                place=f"{field}.columns",
                expected=f"one of {', '.join(map(str, model.columns_options))}",
            )
        under = np.array([[one.east_m, one.north_m, above]])
        ground_z = np.nan if probe is None else float(probe.height_below(under)[0])
        if np.isnan(ground_z):
            raise InputError(
                f"no ground at {one.east_m:g} m east, {one.north_m:g} m north of the anchor",
                file=file,
                place=f"{field}.east_m",
                expected="a place on the site's ground",
            )
        if one.height_m <= 0:
            raise InputError(
                f"{one.height_m:g} m is under the ground",
                file=file,
                place=f"{field}.height_m",
                expected="a height above the ground there, in m",
            )
        position = np.array([one.east_m, one.north_m, ground_z + one.height_m])
        if _is_enclosed(position, buildings):
            raise InputError(
                f"{one.height_m:g} m above {one.east_m:g} m east, {one.north_m:g} m north "
                "is inside a building",
                file=file,
                place=f"{field}.height_m",
                expected="a place outside buildings, or a height above the roof",
            )
        angles = np.radians([one.yaw_deg, one.pitch_deg, one.roll_deg])
        pose = Pose.from_ypr(position, *angles)
        return MountedSensor(one.name, model, columns, pose, one.effects, spec.rate_hz)

    sensors = tuple(mounted(index, one) for index, one in enumerate(spec.sensors))
    first = sensors[0].site_SE3_sensor
    site_SE3_dataset = {
        "sensor": first,
        "level": Pose.from_ypr(first.translation, np.radians(spec.sensors[0].yaw_deg)),
        "site": Pose.from_ypr(np.zeros(3)),
    }[spec.frame]
    return Rig(sensors, spec.frame, spec.rate_hz, site_SE3_dataset.inverse())


def _pattern_columns(
    model: Sensor, one: SensorSpec, rate_hz: float, file: str | Path | None, place: str
) -> int:
    """Return the points per line and frame of a sensor that scans no columns."""
    if one.columns is not None:
        raise InputError(
            f"{model.name} scans a pattern, not columns",
            file=file,
            place=place,
            expected="no columns; points_per_second in the sensor's file",
        )
    columns = round((model.points_per_second or 0.0) / model.channels / rate_hz)
    if not 1 <= columns <= MOST_COLUMNS:
        raise InputError(
            f"{model.name} has {columns} points per line and frame",
            file=file,
            place=place,
            expected=f"1 to {MOST_COLUMNS}: another rate_hz or points_per_second",
        )
    return columns


def _model(name: str, file: str | Path | None, place: str) -> Sensor:
    try:
        return sensor(name, folder=None if file is None else Path(file).parent)
    except InputError as error:
        if error.file is not None:  # The fault is inside a person's own sensor file.
            raise
        raise InputError(error.problem, file=file, place=place, expected=error.expected) from None


def _is_enclosed(point: NDArray[np.float64], buildings: LabelledMesh) -> bool:
    """Return whether any building encloses a point.

    By the winding number of each building around the point: the solid angles of its triangles
    (Van Oosterom and Strackee 1983, IEEE Trans. Biomed. Eng. 30(2), eq. 8) add up to 4 pi inside
    and 0 outside. A building without a floor covers more than 2 pi of every point inside, and
    less than 2 pi of every point outside, so half a turn is the exact border for it too.
    """
    a, b, c = np.moveaxis(buildings.triangles() - point, 1, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    scale = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    solid_angle = 2 * np.arctan2(volume, scale)
    _, building = np.unique(buildings.part, return_inverse=True)
    total = np.bincount(building, solid_angle)
    return bool((np.abs(total) > 2 * np.pi).any())
