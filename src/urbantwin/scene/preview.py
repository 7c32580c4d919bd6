"""Preview of a scene before it is built: ground and buildings around some places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.ground import Elevation
from urbantwin.roads import RoadNetwork, RoadSurface
from urbantwin.scene.building import building_mesh
from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.zones import MARGIN_M
from urbantwin.site import OsmFeature

__all__ = ["ScenePreview", "preview_of_scene"]

#: Buildings within this distance of a place are built, metres: more than the distance of a building
#: part from its building.
NEAR_M = 60.0
#: Minimum width of ground beside streets, metres.
BESIDE_M = 5.0


@dataclass(frozen=True)
class ScenePreview:
    """A preview of a scene before it is built.

    Attributes:
        ground_height: heights of the ground, metres; those of decks are not known.
        extent: area of the future ground, site frame.
        decks: areas of the future bridges, site frame.
        buildings: the buildings around the places, site frame.
    """

    ground_height: GroundHeight
    extent: shapely.Geometry
    decks: shapely.Geometry
    buildings: LabelledMesh


def preview_of_scene(
    places: Sequence[tuple[float, float]],
    network: RoadNetwork,
    surface: RoadSurface,
    elevation: Elevation,
    region: shapely.Polygon,
    features: Sequence[OsmFeature],
    without: shapely.Geometry | None = None,
    country: str | None = None,
) -> ScenePreview:
    """Return a preview around some places, in a hundredth of the time of a scene.

    Args:
        places: (east, north), site frame, metres.
        network: the lanes.
        surface: height of the roads.
        elevation: the ground's heights.
        region: region of interest, site frame.
        features: the map's features.
        without: area in which imported geometry contains the buildings.
        country: ISO 3166-1 alpha-2, for the usual appearance of buildings; empty if unknown.
    """

    def ground_height(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        on_street = surface.on_streets(xy) > 0
        return np.where(on_street, surface.height(xy), elevation.raw_at(xy))

    about = shapely.union_all(shapely.buffer(shapely.points(places), NEAR_M)) if places else None
    near = [one for one in features if about is not None and about.intersects(one.geometry)]
    buildings = building_mesh(
        near,
        region=region,
        ground_height=ground_height,
        carriageway=network.carriageway(0),
        without=without,
        country=country,
    )
    streets = [network.carriageway(0), network.footway(0)]
    lanes = [lane.polygon for lane in network.lanes if lane.level > 0]
    return ScenePreview(
        ground_height,
        shapely.union_all(
            [
                region.buffer(MARGIN_M, join_style="mitre"),
                *(street.buffer(BESIDE_M) for street in streets),
            ]
        ),
        shapely.union_all(lanes),
        buildings.mesh,
    )
