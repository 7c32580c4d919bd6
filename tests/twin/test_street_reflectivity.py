"""Streets differ from site to site, within what was measured of asphalt."""

import numpy as np

from urbantwin.taxonomy import materials
from urbantwin.twin.street_reflectivity import street_reflectivity


def test_streets_are_as_different_as_measured_asphalt_and_the_tables_on_average():
    random = np.random.default_rng(4)
    places = random.uniform(-60, 60, (4000, 2))
    factor = np.array([street_reflectivity(*place)["asphalt"] for place in places])
    assert abs(np.median(factor) - 1) < 0.02
    assert abs(np.log(factor).std() - 0.3) < 0.015
    table = materials()
    bright = factor * table["asphalt"].reflectivity
    dark, light = (table[f"asphalt-{name}"].reflectivity for name in ("dark", "light"))
    assert ((bright > dark) & (bright < 1.15 * light)).mean() > 0.99


def test_a_place_has_one_street():
    assert street_reflectivity(60.17, 24.94) == street_reflectivity(60.17, 24.94)
    assert street_reflectivity(60.17, 24.94) != street_reflectivity(60.1701, 24.94)
