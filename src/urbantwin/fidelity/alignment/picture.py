"""A picture of an alignment: real points over the twin, before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from urbantwin.artefact import replaced_file
from urbantwin.fidelity.alignment.align import Alignment
from urbantwin.fidelity.alignment.ground_plane import thinned
from urbantwin.fidelity.alignment.lane_markings import mark_lines
from urbantwin.fidelity.alignment.road_edges import road_edges
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.fidelity.report_style import INK, blank, from_above, save
from urbantwin.twin import Twin

__all__ = ["draw_alignment"]

_REACH_M, _FARTHEST_M, _THINNED_M = 35.0, 0.5, 0.15
_EDGE, _LINE = "#1d2733", "#e8710a"


def draw_alignment(frame: Frame, twin: Twin, found: Alignment, path: Path) -> None:
    """Write a picture: points from above, coloured by how far the twin's surface is from them.

    Args:
        frame: the real one.
        twin: where it was aligned.
        found: the pose, and where the search began.
        path: the PNG to write.
    """
    middle = found.pose.translation
    around = np.abs(twin.mesh.vertices[twin.mesh.faces][..., :2] - middle[:2])
    near = twin.mesh.select((around.min(axis=1) < 2 * _REACH_M).all(axis=1))
    surface = NearestTriangle(near.vertices, near.faces.astype(np.int64))
    edges = road_edges(twin.ground_mesh)[0]
    lines = mark_lines(twin.surface_materials, middle[:2], _REACH_M)[0]
    away = frame.points - frame.sensor_places.mean(axis=0)
    points = frame.points[np.hypot(*away[:, :2].T) < 1.5 * _REACH_M]
    points = points[thinned(points, _THINNED_M)]
    moving = [("Where the search began", found.start), ("Aligned", found.pose)]
    shown = [(title, pose) for title, pose in moving if pose is not None]
    figure = blank(7.4 * len(shown) + 1.2, 7.6)
    grid = figure.add_gridspec(
        1, len(shown), left=0.05, right=1 - 1.1 / (7.4 * len(shown) + 1.2), top=0.94, bottom=0.06
    )
    for place, (title, pose) in enumerate(shown):
        axes = figure.add_subplot(grid[0, place])
        at = pose.apply(points)
        distance = surface.distances(at)
        said = f"{title}: {_share(distance):.0%} of the points within 0.1 m of the twin"
        shades = colormaps["turbo"](np.clip(distance / _FARTHEST_M, 0, 1))[:, :3]
        from_above(axes, said, middle, _REACH_M, [(at, shades)])
        for marks, colour in ((edges, _EDGE), (lines, _LINE)):
            axes.plot(*marks[:, :2].T, ".", color=colour, markersize=1.5)
    colours = ScalarMappable(Normalize(0, _FARTHEST_M), "turbo")
    bar = figure.colorbar(colours, ax=figure.axes, fraction=0.025, pad=0.02)
    bar.set_label("metres from the twin's surface (black: edges of its roads, orange: its lines)")
    bar.ax.yaxis.label.set_color(INK)
    with replaced_file(path, kind="align picture") as scratch:
        save(figure, scratch)


def _share(distance: NDArray[np.float64]) -> float:
    return float((distance < 0.1).mean())
