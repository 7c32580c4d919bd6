"""Footways and islands where a recording shows how high they are."""

import numpy as np
import pytest
import shapely

from urbantwin.scene.scene import with_measured_curbs
from urbantwin.scene.zones import Zone


def test_each_piece_is_as_high_as_it_was_measured():
    level = shapely.box(0, 0, 10, 3)
    raised = shapely.box(0, 9, 10, 12)
    beyond = shapely.box(60, 0, 70, 3)
    walk = Zone("footway", shapely.union_all([level, raised, beyond]), 1, 1)
    street = Zone("carriageway", shapely.box(0, 3, 10, 9), 2, 2)
    noise = np.random.default_rng(2)

    def road(xy):
        return 0.02 * xy[:, 0]  # it climbs

    def ground(xy):
        high = road(xy) + np.where(xy[:, 1] > 9, 0.12, 0.03) + noise.normal(0, 0.02, len(xy))
        high[::17] += 1.5  # things that stand there
        return high

    found = with_measured_curbs([street, walk], shapely.box(-5, -5, 20, 20), road, ground)
    assert found[0] is street
    steps = {one.area.centroid.y: one.step for one in found[1:] if one.area.centroid.x < 50}
    assert steps[1.5] == pytest.approx(0.03, abs=0.006)
    assert steps[10.5] == pytest.approx(0.12, abs=0.006)
    (far,) = (one for one in found[1:] if one.area.centroid.x > 50)
    assert far.step == walk.step
    assert sum(one.area.area for one in found[1:]) == pytest.approx(walk.area.area)
