"""Lost beams: surfaces of actors and ground that return nothing to single beams.

Real bodies are less plain than meshes: gaps between panels, trim, chrome, folds, spokes and edges
deflect single beams, and a glossy coat reflects specularly away from normal incidence. Of rays at
opaque parts of real vehicles 4 to 10 % return nothing even at close range, one by one between
neighbours that return; of rays at people 2 % (fitted to KITTI and Argoverse 2:
`notebook/real_lidar.md`). The beam and the triangle determine which: a fixed sensor sees a parked
car alike in every frame. Panes vary in dirt by `DIRT`.

**Ground** also loses beams: manhole covers, tar, puddles and ruts reflect or hide grazing light. Of
rays at real roads a few in a thousand are lost near the sensor, and 1 to 2 % at 20 to 40 m, in few
places: ``GLANCING / cosine of incidence``, up to `MOST_THROWN_ON`, in patches of `PLACE_M` (fitted
to KITTI, Argoverse 2 and two Ousters together, `real_lidar.md`).

At any range some surfaces are too faint: the reflectivity at which half is missed is a property of
the receiver (``measured_faintest`` of a sensor; `FAINTEST` if not measured). An HDL-64E reduces its
laser power on bright targets, in eight steps, and drops what is below a fixed noise floor (User
Manual 63-HDL64ES3, Laser Output Power, Noise Level Adjustment); a VLP-32C still sees black cars
with code 0. With a threshold for each, one population of paint and glass explains the losses of
both on real cars. Two VLP-16 at a roadside (LUMPI) see as little of panes as the HDL-64E. A
Pandar64 (PandaSet) loses as little on panes as the VLP-32C, whose value is the default.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from urbantwin.lidar.compiled.patches import add_patches
from urbantwin.lidar.returns.draws import LEVELS, standard_quantiles
from urbantwin.taxonomy import materials

__all__ = ["DIRT", "FAINTEST", "GLANCING", "SWALLOWED", "Losses", "losses", "thrown_on"]

#: Default reflectivity (of white) at which half is missed at close range.
FAINTEST = 0.001
#: Standard deviation of the logarithm of the backscatter of dirt on panes.
DIRT = 1.0
#: Share of beams lost on materials of actors; 0 for others.
SWALLOWED = {
    **dict.fromkeys(("paint-white", "paint-grey", "paint-black", "metal-painted"), 0.06),
    **dict.fromkeys(("metal-dark", "metal-bare", "plastic", "rubber"), 0.06),
    **dict.fromkeys(("retroreflector", "reflex-reflector", "lamp-lens"), 0.06),
    **dict.fromkeys(("cloth", "skin"), 0.02),
}
#: Share of ground lost at normal incidence, largest share, and size of the patches, metres.
GLANCING, MOST_THROWN_ON, PLACE_M = 0.0008, 0.03, 0.4
#: Index of their noise, distinct from those of patches.
_PLACES = 101
#: Factor on the backscatter of a lost beam.
_LEFT = np.float32(1e-4)


class Losses(NamedTuple):
    """Losses on M materials of actors, by draws of 65,536.

    Attributes:
        swallowed: (M,) int64, level below which a draw is lost.
        left: factor on the backscatter of a lost beam.
        panes: (M,) which are panes of cars.
        dirt: (65536,) float32, factor on the backscatter of panes, by draw.
    """

    swallowed: NDArray[np.int64]
    left: np.float32
    panes: NDArray[np.bool_]
    dirt: NDArray[np.float32]


def thrown_on(places: NDArray[np.float64], cosine: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the remaining share (N,) of the backscatter of ground at places (N, 3), site frame.

    Args:
        places: (N, 3) points on the ground.
        cosine: (N,) cosines of incidence.
    """
    drawn = np.zeros(len(places))
    east, north = np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1])
    add_patches(east, north, _PLACES, PLACE_M, 1.0, standard_quantiles(), drawn)
    left = np.ones(len(places), np.float32)
    # Few places can be lost at all.
    rare = np.flatnonzero(drawn > -ndtri(MOST_THROWN_ON) - 1e-6)
    faced = np.maximum(cosine[rare].astype(np.float64), 1e-3)
    share = np.minimum(GLANCING / faced, MOST_THROWN_ON)
    left[rare[drawn[rare] > -ndtri(share)]] = _LEFT
    return left


@cache
def losses(*, swallows: bool) -> Losses:
    """Return the losses on actors; none if ``swallows`` is false."""
    share = [SWALLOWED.get(name, 0.0) if swallows else 0.0 for name in materials()]
    panes = [swallows and name.startswith("glass-") for name in materials()]
    return Losses(
        np.rint(np.array(share) * LEVELS).astype(np.int64),
        _LEFT,
        np.array(panes),
        np.exp(DIRT * standard_quantiles()),
    )
