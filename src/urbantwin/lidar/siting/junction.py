"""The junction that a sensor stands at, in a built scene."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.siting.field_of_view import FieldOfView
from urbantwin.lidar.siting.junction_ground import JunctionGround, ground_of_network
from urbantwin.lidar.siting.pole_places import pole_places
from urbantwin.lidar.siting.surroundings import Surroundings
from urbantwin.lidar.siting.viewpoint import (
    HEIGHTS_M,
    PITCHES_DEG,
    Candidates,
    View,
    best_view,
)
from urbantwin.progress import Progress, untold
from urbantwin.roads import RoadNetwork

__all__ = ["Junction", "Junctions"]

#: A sensor within this of the anchor stands at the anchor's junction, else at the nearest one.
_ANCHOR_M = 80.0
#: A junction farther than this is not the one that a sensor stands at, metres.
_NEAR_M = 60.0


class Junction:
    """The ground around a point of the road network, and what stands there.

    Args:
        middle: (2,) site frame.
        network: the lanes.
        region: the region of interest.
        mesh: the static world.
    """

    def __init__(
        self,
        middle: NDArray[np.float64],
        network: RoadNetwork,
        region: shapely.Polygon,
        mesh: LabelledMesh,
    ) -> None:
        self._network, self._region = network, region
        self.ground: JunctionGround = ground_of_network(network, region, middle)
        self.around = Surroundings(mesh, middle)

    @cached_property
    def _places(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return pole_places(self._network, self._region, self.around.mesh, self.ground.middle)

    def best_view(
        self, field: FieldOfView, *, pitch: float, roll: float, tell: Progress = untold
    ) -> View | None:
        """Return the place on a pole from which a sensor sees most; ``None``: no pole can stand.

        Args:
            field: of view of the sensor.
            pitch: the sensor's, radians, which is tried beside the usual ones.
            roll: the sensor's, radians.
            tell: called with the fraction done (0..1) and what is being done.
        """
        places, off_m = self._places
        if not len(places) or not len(self.ground.points):
            return None
        pitches = tuple(dict.fromkeys([pitch, *np.radians(PITCHES_DEG).tolist()]))
        candidates = Candidates(places, off_m, HEIGHTS_M, pitches, roll)
        return best_view(candidates, self.ground, self.around, field, tell)


class Junctions:
    """The junctions of a site that sensors stand at, each looked at once."""

    def __init__(self, network: RoadNetwork, region: shapely.Polygon, mesh: LabelledMesh) -> None:
        self._made_of = (network, region, mesh)
        self._found: dict[tuple[float, float], Junction] = {}

    def at(self, east_m: float, north_m: float) -> Junction:
        """Return the junction of a sensor: the anchor's, or the nearest of one that is far."""
        middle = self._middle(np.array([east_m, north_m]))
        key = (round(float(middle[0]), 3), round(float(middle[1]), 3))
        if key not in self._found:
            self._found[key] = Junction(np.array(key), *self._made_of)
        return self._found[key]

    def _middle(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        if np.linalg.norm(place) <= _ANCHOR_M:
            return np.zeros(2)
        outlines = [one.polygon for one in self._made_of[0].junctions]
        middles = [shapely.get_coordinates(one.centroid)[0] for one in outlines if not one.is_empty]
        away = [float(np.linalg.norm(one - place)) for one in middles]
        if not away or min(away) > _NEAR_M:
            return place
        return np.asarray(middles[int(np.argmin(away))])
