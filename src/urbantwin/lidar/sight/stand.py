"""Choice of sensor positions: from a map alone, or in a built scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.catalogue import sensor
from urbantwin.lidar.placement import place_rig
from urbantwin.lidar.sensor_options import check_models, columns_of
from urbantwin.lidar.sight.field_of_view import FieldOfView
from urbantwin.lidar.sight.ground import ground_in_plan
from urbantwin.lidar.sight.junction import (
    CLEAR_M,
    HEIGHTS_M,
    PITCHES_DEG,
    Candidates,
    Junction,
    Junctions,
    View,
    best_view,
)
from urbantwin.lidar.sight.line_of_sight import LineOfSight
from urbantwin.lidar.sight.rig_sight import LITTLE, sight_of_rig
from urbantwin.progress import Progress, between, untold
from urbantwin.result_warning import ResultWarning
from urbantwin.roads import RoadNetwork
from urbantwin.scene.building import building_mesh
from urbantwin.scene.map_objects import map_objects
from urbantwin.site import Site
from urbantwin.site.draft import SENSOR, SENSOR_COLUMNS
from urbantwin.site.pole_site import PoleGround, PolePosition, nearest_place
from urbantwin.site.rig import RigSpec, SensorSpec
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.twin.standing_rig import StandingRig

__all__ = ["place_in_sight", "stand_in_sight", "standing_rig", "warnings_of_place"]

#: A sensor is moved if it then sees at least this much more, as a share of the junction.
_WORTH = 0.05
#: Radius around the anchor in which the map is built, metres.
_AROUND_M = 100.0


def standing_rig(
    site: Site,
    network: RoadNetwork,
    mesh: LabelledMesh,
    anchor_height_m: float | None,
    tell: Progress = untold,
) -> StandingRig:
    """Place a site's rig in its scene, and rate what it sees.

    Args:
        site: the site.
        network: its lanes.
        mesh: the static world, site frame.
        anchor_height_m: height of the anchor's ground in the datum of altitudes, if known.
        tell: called with the fraction done (0..1) and a description.

    Raises:
        InputError: a sensor's given position is invalid.
    """
    spec = stand_in_sight(site.rig, network, site.region, mesh, file=site.rig_file, tell=tell)
    rig = place_rig(spec, mesh, file=site.rig_file, anchor_height_m=anchor_height_m)
    sight = sight_of_rig(rig, network, site.region, mesh)
    if sight is None:
        return StandingRig(spec)
    moved = _moves(site.rig, spec)
    notes = {**sight.notes(), **({"moved_m": moved} if moved else {})}
    return StandingRig(spec, notes, tuple(sight.warnings()))


def stand_in_sight(
    spec: RigSpec,
    network: RoadNetwork,
    region: shapely.Polygon,
    mesh: LabelledMesh,
    *,
    file: str | Path | None = None,
    tell: Progress = untold,
) -> RigSpec:
    """Return a rig with final positions of all sensors.

    A sensor whose position is ``proposed`` stays unless it sees clearly more from elsewhere, is
    close to an object, or cannot be there.

    Args:
        spec: the rig as written.
        network: the lanes.
        region: the region of interest.
        mesh: the static world, site frame.
        file: the rig's file, for errors.
        tell: called with the fraction done (0..1) and a description.

    Raises:
        InputError: a sensor's model is unknown.
    """
    junctions = Junctions(network, region, mesh)
    sensors = []
    models = check_models(spec, file=file)
    for n, (written, model) in enumerate(zip(spec.sensors, models, strict=True)):
        if written.proposed and not written.rides:
            assert written.east_m is not None
            assert written.north_m is not None
            junction = junctions.at(written.east_m, written.north_m)
            field = FieldOfView.coarse(model, columns_of(model, written, spec.rate_hz))
            pitch, roll = np.radians([written.pitch_deg, written.roll_deg]).tolist()
            telling = between(tell, n / len(models), (n + 1) / len(models))
            best = junction.best_view(field, pitch=pitch, roll=roll, tell=telling)
            if best is not None and not _stays(written, best, spec, junction, mesh):
                sensors.append(_moved(written, best))
                continue
        sensors.append(written.model_copy(update={"proposed": None}))
    return spec.model_copy(update={"sensors": sensors})


def _stays(
    written: SensorSpec, best: View, spec: RigSpec, junction: Junction, mesh: LabelledMesh
) -> bool:
    """Return whether a sensor keeps its proposed position rather than the best one."""
    try:
        mounted = place_rig(spec.model_copy(update={"sensors": [written]}), mesh).sensors[0]
    except InputError:  # invalid position
        return False
    now = junction.view_of(mounted)
    return now.nearest_m >= CLEAR_M and best.score <= now.score + _WORTH


def _moves(written: RigSpec, standing: RigSpec) -> dict[str, float]:
    """Return the distance between proposed and final position of each moved sensor, metres."""
    away = {
        before.name: float(np.linalg.norm(_place(now) - _place(before)))
        for before, now in zip(written.sensors, standing.sensors, strict=True)
        if before.proposed
    }
    return {name: round(metres, 1) for name, metres in away.items() if metres > 0.05}


def _place(written: SensorSpec) -> NDArray[np.float64]:
    """Return east, north and height above the ground (3,), metres; 0 if not given."""
    return np.nan_to_num(
        np.array([written.east_m, written.north_m, written.height_m], dtype=np.float64)
    )


def _moved(written: SensorSpec, best: View) -> SensorSpec:
    return written.model_copy(
        update={
            **best.stance.written(),
            "up_m": None,
            "altitude_m": None,
            "proposed": None,
        }
    )


def place_in_sight(ground: PoleGround) -> PolePosition:
    """Return the best position and height for the sensor of a first site.

    Buildings, trees and other objects of the map are built as in a twin, on level ground.
    """
    seen = ground_in_plan(ground.junction)
    if not len(seen.points):
        return nearest_place(ground)
    around = LineOfSight(_mapped_world(ground), seen.middle)
    model = sensor(SENSOR)
    places = ground.places()
    candidates = Candidates(
        np.column_stack([places, np.zeros(len(places))]),
        shapely.distance(ground.paved, shapely.points(places)),
        HEIGHTS_M,
        tuple(np.radians(PITCHES_DEG).tolist()),
        roll=0.0,
    )
    best = best_view(candidates, seen, around, FieldOfView.coarse(model, SENSOR_COLUMNS))
    return PolePosition(**best.stance.written(), seen=best.seen)


def warnings_of_place(pole: PolePosition) -> Iterator[ResultWarning]:
    """Yield warnings about a position chosen from the map."""
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
