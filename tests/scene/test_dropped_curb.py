"""Curbs at crossings are low, and rise within the slope that guidelines allow."""

import numpy as np
import shapely

from urbantwin.geometry import DownwardProbe
from urbantwin.scene.dropped_curb import LIP_M, DroppedCurbs
from urbantwin.scene.surface import Spacing, surface_mesh
from urbantwin.scene.zones import Zone


def street(drops):
    """A 7 m street between 3 m sidewalks, on a slope of 4 %, with a crossing 3 m wide at x = 20."""
    zones = [
        Zone("carriageway", shapely.box(0, 0, 40, 7), 40, 1),
        Zone("footway", shapely.box(0, -3, 40, 0), 48, 3),
        Zone("footway", shapely.box(0, 7, 40, 10), 48, 3),
    ]
    return surface_mesh(
        zones,
        road_height=lambda xy: 0.04 * xy[:, 0],
        terrain_height=lambda xy: np.zeros(len(xy)),
        spacing=Spacing(5, 5),
        drops=drops,
    )


def rise(mesh, xy):
    """Height above the street's plane."""
    z = DownwardProbe(mesh).height_below(np.column_stack([xy, np.full(len(xy), 50.0)]))
    return z - 0.04 * np.asarray(xy)[:, 0]


CROSSING = DroppedCurbs([shapely.box(18.5, 0, 21.5, 7)])


def test_the_curb_is_low_at_the_crossing_and_whole_elsewhere():
    mesh = street(CROSSING)
    along = np.arange(18.5, 21.6, 0.25)
    at_curb = np.column_stack([along, np.full(len(along), -0.02)])
    assert np.allclose(rise(mesh, at_curb), LIP_M, atol=0.005)
    away = np.column_stack(
        [np.r_[np.arange(1, 16, 0.5), np.arange(24, 39, 0.5)], np.full(60, -0.3)]
    )
    assert np.allclose(rise(mesh, away), 0.15, atol=1e-6)


def test_no_slope_of_the_ramp_is_steeper_than_one_in_twelve():
    mesh = street(CROSSING)
    x, y = np.meshgrid(np.arange(15, 25, 0.1), np.arange(-2.9, -0.05, 0.1))
    height = rise(mesh, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    steepest = max(np.abs(np.diff(height, axis=0)).max(), np.abs(np.diff(height, axis=1)).max())
    assert steepest / 0.1 < 1 / 12 + 0.005
    assert height.min() > 0.0
    assert height.max() < 0.15 + 1e-6


def test_the_surface_stays_whole():
    mesh = street(CROSSING)
    x, y = np.meshgrid(np.arange(0.05, 40, 0.1), np.arange(-2.95, 10, 0.1))
    xy = np.column_stack([x.ravel(), y.ravel()])
    assert np.isfinite(rise(mesh, xy)).all()
    edges = np.sort(
        np.unique(np.round(mesh.vertices * 1e4), axis=0, return_inverse=True)[1].ravel()[
            mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        ],
        axis=1,
    )
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    places = np.unique(np.round(mesh.vertices * 1e4), axis=0) / 1e4
    once = places[unique[uses == 1]].mean(axis=1)[:, :2]
    border = shapely.box(0, -3, 40, 10).exterior
    assert shapely.distance(shapely.points(once), border).max() < 1e-3
