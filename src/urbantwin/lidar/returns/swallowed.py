"""What actors and ground swallow: beams that meet a surface which sends nothing back to them.

Real bodies are not as plain as meshes: gaps between panels, trim, chrome, folds, spokes and edges
send single beams elsewhere, and a glossy coat mirrors away what does not meet it squarely. Of rays
at opaque parts of real vehicles 4 to 10 of 100 return nothing even where cars are bright and near,
one by one between neighbours that return; of rays at people 2 (KITTI and Argoverse 2, fitted:
`notebook/real_lidar.md`). Which beams are lost depends on the beam and the triangle: a static
sensor sees a static car alike in every frame. Panes differ in their dirt by `DIRT`.

**Ground** throws some beams on: lids, tar, puddles and ruts mirror or hide what comes in flat. Of
rays at real roads some of a thousand are lost near the sensor, where light abounds, and 1 to 2 of
a hundred at 20 to 40 m, in few places: ``GLANCING / cosine of incidence``, up to `MOST_THROWN_ON`,
in places of `PLACE_M` (fitted to KITTI, Argoverse 2 and two Ousters together, `real_lidar.md`).

However near a surface is, something is too faint: half of what sends back a certain share of white
is missed. That is the receiver's, not the surface's (``measured_faintest`` of a sensor; `FAINTEST`
where nobody measured it). An HDL-64E turns its lasers down where they meet something bright, in
eight steps, and drops what lies below a fixed noise floor (User Manual 63-HDL64ES3, Laser Output
Power, Noise Level Adjustment); a VLP-32C still sees black cars whose codes are all 0. With a
threshold for each, one population of coats and panes gives what both lose of real cars. Two VLP-16
at a roadside (LUMPI) see as little of panes as the HDL-64E. A Pandar64 (PandaSet) loses as little
at panes as the VLP-32C, so that is what is believed of others.
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

#: Share of white of which half is missed next to a sensor of which it was not measured.
FAINTEST = 0.001
#: Standard deviation of the logarithm of what dirt on panes scatters.
DIRT = 1.0
#: Share of beams that a material of actors swallows; 0 for those that are not named.
SWALLOWED = {
    **dict.fromkeys(("paint-white", "paint-grey", "paint-black", "metal-painted"), 0.06),
    **dict.fromkeys(("metal-dark", "metal-bare", "plastic", "rubber"), 0.06),
    **dict.fromkeys(("retroreflector", "reflex-reflector", "lamp-lens"), 0.06),
    **dict.fromkeys(("cloth", "skin"), 0.02),
}
#: Share of ground that throws on what meets it squarely, the most, and how large its places are.
GLANCING, MOST_THROWN_ON, PLACE_M = 0.0008, 0.03, 0.4
#: Number of their noise, apart from those of patches.
_PLACES = 101
#: What a beam that is swallowed sends back of what it would.
_LEFT = np.float32(1e-4)


class Losses(NamedTuple):
    """What is lost on M materials of actors, by draws of 65,536.

    Attributes:
        swallowed: (M,) int64, level below which a draw is swallowed.
        left: what a beam that is swallowed sends back of what it would.
        panes: (M,) which are panes of cars.
        dirt: (65536,) float32, what dirt makes of the backscatter of panes, by draw.
    """

    swallowed: NDArray[np.int64]
    left: np.float32
    panes: NDArray[np.bool_]
    dirt: NDArray[np.float32]


def thrown_on(places: NDArray[np.float64], cosine: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return what is left (N,) of the backscatter of ground at places (N, 3), site frame.

    Args:
        places: (N, 3) of the ground.
        cosine: (N,) of the angles of incidence.
    """
    drawn = np.zeros(len(places))
    east, north = np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1])
    add_patches(east, north, _PLACES, PLACE_M, 1.0, standard_quantiles(), drawn)
    left = np.ones(len(places), np.float32)
    # Few are drawn so that they may be thrown on at all.
    rare = np.flatnonzero(drawn > -ndtri(MOST_THROWN_ON) - 1e-6)
    faced = np.maximum(cosine[rare].astype(np.float64), 1e-3)
    share = np.minimum(GLANCING / faced, MOST_THROWN_ON)
    left[rare[drawn[rare] > -ndtri(share)]] = _LEFT
    return left


@cache
def losses(*, swallows: bool) -> Losses:
    """Return what of actors is lost; where nothing is swallowed, nothing."""
    share = [SWALLOWED.get(name, 0.0) if swallows else 0.0 for name in materials()]
    panes = [swallows and name.startswith("glass-") for name in materials()]
    return Losses(
        np.rint(np.array(share) * LEVELS).astype(np.int64),
        _LEFT,
        np.array(panes),
        np.exp(DIRT * standard_quantiles()),
    )
