import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from urbantwin.geometry import area_difference, area_intersection, area_union, areas_of, grown


def strip(angle, offset):
    """A street 7 m wide through the origin: many of them nearly coincide."""
    a = np.radians(angle)
    line = shapely.LineString(
        [(-60 * np.cos(a), -60 * np.sin(a)), (60 * np.cos(a), 60 * np.sin(a))]
    )
    return shapely.transform(line.buffer(3.5, cap_style="flat"), lambda xy: xy + offset)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 180), st.floats(0, 1e-6)), min_size=2, max_size=8))
def test_inclusion_and_exclusion(streets):
    shapes = [strip(*street) for street in streets]
    first, rest = shapes[0], area_union(shapes[1:])
    both, only = area_intersection(first, rest), area_difference(first, rest)
    together = area_union([first, rest])
    assert all(shape.is_valid for shape in (both, only, together))
    assert both.area + only.area == pytest.approx(first.area, abs=0.5)
    assert only.area + rest.area == pytest.approx(together.area, abs=0.5)


def test_only_areas_are_left():
    mixed = shapely.GeometryCollection(
        [shapely.box(0, 0, 2, 2), shapely.Point(5, 5), shapely.LineString([(0, 0), (9, 9)])]
    )
    assert areas_of(mixed).area == pytest.approx(4.0)
    assert areas_of(shapely.box(0, 0, 0.05, 0.05)).is_empty
    bow_tie = shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
    assert areas_of(bow_tie).area == pytest.approx(2.0)


def test_growing_keeps_right_angles():
    assert grown(shapely.box(0, 0, 4, 4), 1.0).area == pytest.approx(36.0, abs=1e-6)
    assert grown(shapely.box(0, 0, 4, 4), -2.1).is_empty
