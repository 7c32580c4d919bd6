"""Box size of an actor as annotators draw it: constant over the track."""

from __future__ import annotations

from functools import cache

import numpy as np

from urbantwin.traffic.assets import Asset, asset_mesh

__all__ = ["track_size"]


def track_size(asset: Asset) -> tuple[float, float, float]:
    """Return length, width and height of an actor's constant box, metres.

    For pedestrians it is the median of the sizes over a gait cycle: annotators fit one box to a
    track, neither to the widest step nor to the moment when the legs pass each other (a man's
    length varies from 0.32 to 0.97 m). For all others it is the mesh's size.
    """
    if asset.phases == 1:
        return asset.length, asset.width, asset.height
    return _middle_size(asset.name, asset.phases)


@cache
def _middle_size(name: str, phases: int) -> tuple[float, float, float]:
    sizes = [np.ptp(asset_mesh(name, phase).vertices, axis=0) for phase in range(phases)]
    length, width, height = np.median(sizes, axis=0).tolist()
    return length, width, height
