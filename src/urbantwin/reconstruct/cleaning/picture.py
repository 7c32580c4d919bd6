"""The data of a picture of cleaning."""

from __future__ import annotations

from dataclasses import dataclass

import shapely

from urbantwin.io.model import PointCloud, TriangleMesh
from urbantwin.reconstruct.cleaning.removal import Removal

__all__ = ["CleaningPicture"]


@dataclass(frozen=True, eq=False)
class CleaningPicture:
    """What a picture of cleaning shows, before and after.

    Attributes:
        before: the mesh (or points) as it came, in the region and a little around.
        after: as it is now.
        removed: what was taken out.
        kept: what an override kept.
        passed: objects on the carriageway that do not qualify as vehicles.
        region: of interest.
        roads: carriageways, may be empty.
    """

    before: TriangleMesh | PointCloud
    after: TriangleMesh | PointCloud
    removed: tuple[Removal, ...]
    kept: tuple[Removal, ...]
    passed: tuple[Removal, ...]
    region: shapely.Geometry
    roads: shapely.Geometry
