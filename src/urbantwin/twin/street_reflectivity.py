"""Default reflectivity of a site's streets, without a measurement.

Asphalt reflects from 6 % (fresh) to 28 % (bleached) at 905 nm (``asphalt-dark`` and
``asphalt-light`` of the table of materials, both measured), and markings fade. So the table's
values are multiplied by a factor drawn from the site's position: log-normal about 1, with `SPREAD`
such that the measured extremes are 2.5 standard deviations away. ``reflectivity:`` of a rig, given
by hand or by `urbantwin rig tune`, replaces it.
"""

from __future__ import annotations

import hashlib

import numpy as np

__all__ = ["SPREAD", "street_reflectivity"]

#: Standard deviation of the logarithm of each material's factor between sites. That of paint,
#: between new (0.7) and worn markings (0.43), is an estimate.
SPREAD = {"asphalt": 0.3, "road-paint": 0.25}
#: Decimals of latitude and longitude, degrees, for the seed: 1.1 m on the ground.
_SEED_DECIMALS = 5


def street_reflectivity(latitude: float, longitude: float) -> dict[str, float]:
    """Return the factors on the reflectivity of a site's materials, by name.

    Args:
        latitude: latitude of the site's anchor, degrees.
        longitude: longitude of the site's anchor, degrees.
    """
    factors = {}
    for name, spread in SPREAD.items():
        place = f"{name} {latitude:.{_SEED_DECIMALS}f} {longitude:.{_SEED_DECIMALS}f}"
        seed = int.from_bytes(hashlib.sha256(place.encode()).digest()[:8], "big")
        drawn = np.random.default_rng(seed).standard_normal()
        factors[name] = round(float(np.exp(spread * np.clip(drawn, -2.5, 2.5))), 3)
    return factors
