"""A place without any map: no roads and no traffic."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from urbantwin.ground import Elevation
from urbantwin.roads.build import BuiltRoads
from urbantwin.roads.grade_separation import Lift
from urbantwin.roads.heights import with_heights
from urbantwin.roads.model import LaneModel
from urbantwin.roads.network import RoadNetwork

__all__ = ["no_roads"]

_NET = '<?xml version="1.0" encoding="UTF-8"?>\n<net version="1.20"/>\n'
_NOT_LIFTED = Lift(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0))


def no_roads(elevation: Elevation, driving_side: str, out: Path) -> BuiltRoads:
    """Return a lane model without lanes, and write a SUMO network without edges.

    Args:
        elevation: the ground.
        driving_side: ``right`` or ``left``.
        out: the ``.net.xml`` to write.
    """
    model, surface = with_heights(LaneModel(driving_side, ()), elevation, _NOT_LIFTED)
    out.write_text(_NET, encoding="utf-8")
    network = RoadNetwork(driving_side, (), (), (), (), ())
    return BuiltRoads(model, network, surface, {"roads": 0, "map": "none"})
