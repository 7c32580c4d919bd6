"""How bright the streets of a site are, where nobody has measured it.

Asphalt is from 6 % (fresh) to 28 % (bleached) reflective at 905 nm (``asphalt-dark`` and
``asphalt-light`` of the table of materials, both measured), and lines fade. So a site's streets are
as bright as the table's by a factor that its place decides: log-normal about 1, with `SPREAD` such
that the measured extremes are 2.5 standard deviations away. ``reflectivity:`` of a rig, by hand or
by `urbantwin rig tune`, takes its place.
"""

from __future__ import annotations

import hashlib

import numpy as np

__all__ = ["SPREAD", "street_reflectivity"]

#: Standard deviation of the logarithm of each material's factor from site to site. That of paint,
#: between new lines (0.7) and worn ones (0.43), is an estimate.
SPREAD = {"asphalt": 0.3, "road-paint": 0.25}
#: Decimals of latitude and longitude, degrees, that the seed is drawn from: 1.1 m on the ground.
_DIGITS = 5


def street_reflectivity(latitude: float, longitude: float) -> dict[str, float]:
    """Return the factors on the reflectivity of a site's materials, by name.

    Args:
        latitude: of the site's anchor, degrees.
        longitude: of the same.
    """
    factors = {}
    for name, spread in SPREAD.items():
        place = f"{name} {latitude:.{_DIGITS}f} {longitude:.{_DIGITS}f}"
        seed = int.from_bytes(hashlib.sha256(place.encode()).digest()[:8], "big")
        drawn = np.random.default_rng(seed).standard_normal()
        factors[name] = round(float(np.exp(spread * np.clip(drawn, -2.5, 2.5))), 3)
    return factors
