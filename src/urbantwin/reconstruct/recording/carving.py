"""Removal of triangles that the rays of a recording passed through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.reconstruct.recording.beams import Beams
from urbantwin.reconstruct.recording.facets import Facets

__all__ = ["carved"]

#: A ray ends on a triangle within this distance (metres) plus this share of its range.
_NEAR_M, _NEAR_SHARE = 0.15, 0.005
#: A piece is removed if the ratio of passing to ending rays is larger.
_PASSED = 1.0
#: Maximum number of rounds, as carving uncovers pieces behind.
_ROUNDS = 6
#: Weight of a beam without any return: it may have hit a dark surface.
_SILENT = 0.5


def carved(facets: Facets, every: Sequence[Beams]) -> tuple[Facets, dict[str, int]]:
    """Return the pieces that are consistent with the rays of all sensors, and statistics.

    A ray proves that the space before its return is free, and that its end is occupied. A piece
    that more rays pass than end on was drawn between two objects, or belongs to an object that one
    sensor sees and others see through.
    """
    rays = [_rays_of(one) for one in every]
    origin, way, far, weight = (np.concatenate(part) for part in zip(*rays, strict=True))
    notes = {"pieces": int(facets.piece.max(initial=-1)) + 1}
    for _ in range(_ROUNDS):
        if not len(facets.corners):
            break
        corners = facets.corners.reshape(-1, 3)
        caster = Rays(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
        face, range_m = caster.first(origin, way)
        meets = face >= 0
        behind = np.zeros(len(face))
        behind[meets] = far[meets] - range_m[meets]
        reach = _NEAR_M + _NEAR_SHARE * np.where(np.isfinite(far), far, 0.0)
        piece = facets.piece[np.maximum(face, 0)]
        count = int(facets.piece.max()) + 1
        passed = np.bincount(piece, weight * (meets & (behind > reach)), count)
        ended = np.bincount(piece, weight * (meets & (np.abs(behind) <= reach)), count)
        gone = passed > _PASSED * ended
        if not gone.any():
            break
        facets = facets.select(~gone[facets.piece])
    notes["kept"] = len(np.unique(facets.piece))
    return facets, notes


def _rays_of(
    beams: Beams,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return origins, directions, lengths and weights of rays."""
    some = beams.range_m[:, 0] > 0
    way = np.concatenate([beams.direction[some], beams.silent])
    far = np.concatenate([beams.range_m[some, 0], np.full(len(beams.silent), np.inf)])
    weight = np.concatenate([beams.share[some, 0], np.full(len(beams.silent), _SILENT)])
    return np.broadcast_to(beams.place, way.shape).copy(), way, far, weight
