"""Choosing the place of a sensor from a map alone, before anything is built."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.catalogue import sensor
from urbantwin.lidar.siting.field_of_view import FieldOfView
from urbantwin.lidar.siting.junction_ground import ground_in_plan
from urbantwin.lidar.siting.rig_sight import LITTLE
from urbantwin.lidar.siting.surroundings import Surroundings
from urbantwin.lidar.siting.viewpoint import HEIGHTS_M, PITCHES_DEG, Candidates, best_view
from urbantwin.result_warning import ResultWarning
from urbantwin.scene.building import building_mesh
from urbantwin.scene.map_objects import map_objects
from urbantwin.site.draft import SENSOR, SENSOR_COLUMNS
from urbantwin.site.pole_site import PoleGround, PolePosition, nearest_place
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["place_in_sight", "warnings_of_place"]

#: What is built of the map: so far around the anchor, metres.
_AROUND_M = 100.0


def place_in_sight(ground: PoleGround) -> PolePosition:
    """Return the place and height from which the sensor of a first site sees most of the junction.

    Buildings, trees and all else that is mapped are built as a twin has them, on level ground.
    """
    seen = ground_in_plan(ground.junction)
    if not len(seen.points):
        return nearest_place(ground)
    around = Surroundings(_mapped_world(ground), seen.middle)
    model = sensor(SENSOR)
    places = ground.places()
    candidates = Candidates(
        np.column_stack([places, np.zeros(len(places))]),
        shapely.distance(ground.paved, shapely.points(places)),
        HEIGHTS_M,
        tuple(np.radians(PITCHES_DEG).tolist()),
        roll=0.0,
    )
    best = best_view(candidates, seen, around, FieldOfView.of_sensor(model, SENSOR_COLUMNS))
    return PolePosition(**best.stance.written(), seen=best.seen)


def warnings_of_place(pole: PolePosition) -> Iterator[ResultWarning]:
    """Yield what is wrong with a place that was chosen from the map."""
    if pole.seen is not None and pole.seen < LITTLE:
        yield ResultWarning(
            "sensor",
            f"no place on a pole has more of the junction in sight than {100 * pole.seen:.0f} %",
            "buildings, trees and other things of the map hide the rest",
            "add a second sensor, or a place that is better in truth",
        )


def _mapped_world(ground: PoleGround) -> LabelledMesh:
    disc = shapely.Point(0.0, 0.0).buffer(_AROUND_M)
    buildings = building_mesh(
        ground.features, region=disc, ground_height=_level, carriageway=ground.paved
    ).mesh
    objects = map_objects(
        ground.features, (), region=disc, ground_height=_level, carriageway=ground.paved
    )
    meshes = [mesh for mesh, _ in objects.values()]
    return LabelledMesh.concatenate([_plain(), buildings, *meshes])


def _level(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros(len(xy))


def _plain() -> LabelledMesh:
    """Return level ground."""
    side = 2 * _AROUND_M
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return LabelledMesh.build(corners, faces, semantic_id("terrain"), material_id("grass"), 0)
