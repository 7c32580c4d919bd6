"""Edges in plan where they are cut."""

import numpy as np
import shapely

from urbantwin.geometry import moved_left
from urbantwin.roads.junctions.strip import cut


def test_no_short_leg_is_left_where_a_line_is_cut():
    """Beside a leg of a centimetre across the line, a lane would begin backwards."""
    line = shapely.LineString([(0, 0), (10, 0), (10.01, 0.01), (20, 0), (30, 0)])
    points = cut(line, 9.995, 25.0)
    lane = moved_left(points, -2.5)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).min() > 0.2
    assert (np.diff(lane[:, 0]) > 0).all()
    np.testing.assert_allclose(points[[0, -1]], [[9.995, 0], [25, 0]], atol=1e-2)
