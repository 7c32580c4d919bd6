"""Standing a rig on a built scene: a sensor whose place nobody chose stands where it sees most."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.placement import place_rig
from urbantwin.lidar.sensor_options import check_models, columns_of
from urbantwin.lidar.siting.field_of_view import FieldOfView
from urbantwin.lidar.siting.junction import Junction, Junctions
from urbantwin.lidar.siting.rig_sight import sight_of_rig, view_of
from urbantwin.lidar.siting.viewpoint import CLEAR_M, View
from urbantwin.progress import Progress, between, untold
from urbantwin.roads import RoadNetwork
from urbantwin.site import Site
from urbantwin.site.rig import RigSpec, SensorSpec
from urbantwin.twin.standing_rig import StandingRig

__all__ = ["stand_in_sight", "standing_rig"]

#: A sensor moves where it sees so much more of the junction, as a share.
_WORTH = 0.05


def standing_rig(
    site: Site,
    network: RoadNetwork,
    mesh: LabelledMesh,
    anchor_height_m: float | None,
    tell: Progress = untold,
) -> StandingRig:
    """Stand a site's rig on its scene, and look at what it sees.

    Args:
        site: the site.
        network: its lanes.
        mesh: the static world, site frame.
        anchor_height_m: of the anchor's ground above the zero of altitudes, where it is known.
        tell: called with the fraction done (0..1) and what is being done.

    Raises:
        InputError: a sensor cannot stand where somebody put it.
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
    """Return a rig in which every sensor has its place, and no place is a proposal.

    A sensor whose place is ``proposed`` stays there unless it sees clearly more from elsewhere,
    stands close to something, or cannot stand there at all.

    Args:
        spec: the rig as written.
        network: the lanes.
        region: the region of interest.
        mesh: the static world, site frame.
        file: the rig's file, for errors.
        tell: called with the fraction done (0..1) and what is being done.

    Raises:
        InputError: a sensor's model is not known.
    """
    junctions = Junctions(network, region, mesh)
    sensors = []
    models = check_models(spec, file=file)
    for n, (one, model) in enumerate(zip(spec.sensors, models, strict=True)):
        if one.proposed and not one.rides:
            assert one.east_m is not None
            assert one.north_m is not None
            junction = junctions.at(one.east_m, one.north_m)
            field = FieldOfView.of_sensor(model, columns_of(model, one, spec.rate_hz))
            pitch, roll = np.radians([one.pitch_deg, one.roll_deg]).tolist()
            telling = between(tell, n / len(models), (n + 1) / len(models))
            best = junction.best_view(field, pitch=pitch, roll=roll, tell=telling)
            if best is not None and not _stays(one, best, spec, junction, mesh):
                sensors.append(_moved(one, best))
                continue
        sensors.append(one.model_copy(update={"proposed": None}))
    return spec.model_copy(update={"sensors": sensors})


def _stays(
    one: SensorSpec, best: View, spec: RigSpec, junction: Junction, mesh: LabelledMesh
) -> bool:
    """Return whether a sensor stays where it was proposed, though there is a best place."""
    try:
        mounted = place_rig(spec.model_copy(update={"sensors": [one]}), mesh).sensors[0]
    except InputError:  # It cannot stand there.
        return False
    now = view_of(mounted, junction)
    return now.nearest_m >= CLEAR_M and best.score <= now.score + _WORTH


def _moves(written: RigSpec, standing: RigSpec) -> dict[str, float]:
    """Return how far each sensor that moved stands from where it was proposed, metres."""
    away = {
        one.name: float(np.linalg.norm(_place(now) - _place(one)))
        for one, now in zip(written.sensors, standing.sensors, strict=True)
        if one.proposed
    }
    return {name: round(metres, 1) for name, metres in away.items() if metres > 0.05}


def _place(one: SensorSpec) -> NDArray[np.float64]:
    """Return east, north and height above the ground (3,), metres; 0 where none is given."""
    return np.nan_to_num(np.array([one.east_m, one.north_m, one.height_m], dtype=np.float64))


def _moved(one: SensorSpec, best: View) -> SensorSpec:
    return one.model_copy(
        update={
            **best.stance.written(),
            "up_m": None,
            "altitude_m": None,
            "proposed": None,
        }
    )
