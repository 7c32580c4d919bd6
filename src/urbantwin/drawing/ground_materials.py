"""The materials of the ground in plan, as seen from above."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.drawing.surface_colours import material_colours
from urbantwin.geometry import DownwardProbe, LabelledMesh, SurfaceMaterials
from urbantwin.taxonomy import materials

__all__ = ["ground_figure", "ground_picture", "materials_from_above"]

#: Pixels along the longer side of the picture.
_PIXELS = 1400
#: Colour of objects on the ground.
_STANDS = np.array([0.80, 0.80, 0.79])


def ground_picture(
    mesh: LabelledMesh,
    surface: SurfaceMaterials,
    region: shapely.Polygon,
    path: Path,
    *,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw the materials of the ground in a region.

    Args:
        mesh: the static scene, site frame, metres.
        surface: materials of the ground that are finer than the mesh.
        region: the region to draw.
        path: the PNG to write.
        title: a line above.
        attribution: sources of the data.
    """
    figure = ground_figure(mesh, surface, region, title=title, attribution=attribution)
    return style.save(figure, path)


def ground_figure(
    mesh: LabelledMesh,
    surface: SurfaceMaterials,
    region: shapely.Polygon,
    *,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Figure:
    """Return the figure of ``ground_picture``."""
    west, south, east, north = region.bounds
    step = max(east - west, north - south) / _PIXELS
    shape = round((north - south) / step), round((east - west) / step)
    material = materials_from_above(mesh, surface, west, south, step, shape)
    colours = material_colours() ** (1 / 2.2)
    picture = np.where((material >= 0)[..., None], colours[material], _STANDS)
    figure = style.new_figure(10.0, 10.0 * shape[0] / shape[1] + 1.2)
    axes = figure.add_axes((0.02, 0.1, 0.96, 0.84))
    style.bare(axes)
    axes.imshow(picture[::-1], extent=(west, east, south, north), interpolation="nearest")
    style.scale_bar(axes)
    names = {m.id: m.name for m in materials().values()}
    number, count = np.unique(material[material >= 0], return_counts=True)
    shown = [n for n, c in zip(number, count, strict=True) if c > 1e-4 * material.size]
    handles = [Patch(facecolor=colours[n], edgecolor="#777777", label=names[int(n)]) for n in shown]
    figure.legend(
        handles=handles,
        loc="lower center",
        ncol=min(8, max(1, len(handles))),
        frameon=False,
        fontsize=9,
        labelcolor=style.INK,
        bbox_to_anchor=(0.5, 0.025),
    )
    if title:
        figure.text(0.02, 0.962, title, fontsize=13, color=style.INK, weight="bold")
    style.written_attribution(figure, attribution)
    return figure


def materials_from_above(
    mesh: LabelledMesh,
    surface: SurfaceMaterials,
    x0: float,
    y0: float,
    step: float,
    shape: tuple[int, int],
) -> NDArray[np.int64]:
    """Return the material (ny, nx) of the uppermost surface; -1 if it is not ground.

    Args:
        mesh: the static scene.
        surface: materials of the ground that are finer than the mesh.
        x0: west edge, metres.
        y0: south edge, metres.
        step: side of a cell, metres.
        shape: rows, from the south, and columns.
    """
    x = x0 + (np.arange(shape[1]) + 0.5) * step
    y = y0 + (np.arange(shape[0]) + 0.5) * step
    east, north = np.meshgrid(x, y)
    top = float(mesh.vertices[:, 2].max(initial=0.0)) + 1.0
    points = np.column_stack([east.ravel(), north.ravel(), np.full(east.size, top)])
    probe = DownwardProbe(mesh)
    face = probe.face_below(points)
    points[:, 2] = np.nan_to_num(probe.height_below(points))
    hit = np.flatnonzero((face >= 0) & mesh.is_ground[face])
    found = np.full(len(points), -1, np.int64)
    found[hit] = surface.materials_of(mesh, face[hit], points[hit])
    return found.reshape(shape)
