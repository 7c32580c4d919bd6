"""Pictures of imported geometry: its registration and its cleaning."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.drawing.cleaning import cleaning_picture
from urbantwin.reconstruct import Reconstruction, Surroundings
from urbantwin.reconstruct.georeference import Registration

__all__ = ["pictures_of_geometry", "registration_picture"]

_ROAD, _BUILDING, _REGION = "#26313c", "#5d7186", "#46535f"
_BEFORE, _AFTER = "#ff7a59", style.ACCENT


def registration_picture(
    registration: Registration,
    surroundings: Surroundings,
    path: Path,
    *,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw a model's walls over roads and outlines of buildings, before and after.

    Args:
        registration: result of `placed`.
        surroundings: the map in plan.
        path: the PNG to write.
        title: title of the picture: the source's name.
        attribution: sources of the data.
    """
    figure = style.new_figure(14, 8.3)
    style.title(figure, title or "Registration", registration.lines[0])
    west, south, east, north = shapely.bounds(surroundings.region)
    margin = 0.06 * max(east - west, north - south)
    for left, heading, walls, colour in (
        (0.02, "before", registration.before, _BEFORE),
        (0.51, "after", registration.after, _AFTER),
    ):
        axes = figure.add_axes((left, 0.1, 0.47, 0.76))
        style.bare(axes)
        axes.set_aspect("equal")
        axes.set_xlim(west - margin, east + margin)
        axes.set_ylim(south - margin, north + margin)
        _shape(axes, surroundings.roads, _ROAD)
        for outline in surroundings.footprints:
            _shape(axes, outline, _BUILDING, filled=False)
        _shape(axes, surroundings.region, _REGION, filled=False)
        axes.plot(walls[:, 0], walls[:, 1], ".", color=colour, markersize=1.6, zorder=5)
        outside = _share_outside(walls, (west, south, east, north))
        text = heading if outside < 0.5 else f"{heading} ({outside:.0%} lies outside)"
        axes.set_title(text, color=colour, loc="left", fontsize=13, weight="bold")
        style.scale_bar(axes)
        style.north_arrow(axes)
    figure.text(
        0.03,
        0.05,
        "   ".join(registration.lines[1:]),
        color=style.INK,
        fontsize=11,
        va="center",
    )
    figure.text(
        0.03,
        0.02,
        "dots: walls of the model    outlines: mapped buildings    dark: roads",
        color=style.MUTED,
        fontsize=9.5,
        va="center",
    )
    style.written_attribution(figure, attribution)
    return style.save(figure, path)


def _share_outside(xy: NDArray[np.float64], bounds: tuple[float, float, float, float]) -> float:
    if not len(xy):
        return 0.0
    inside = (xy >= bounds[:2]).all(axis=1) & (xy <= bounds[2:]).all(axis=1)
    return 1.0 - float(inside.mean())


def _shape(axes: Axes, shape: shapely.Geometry, colour: str, *, filled: bool = True) -> None:
    """Draw polygons with their holes."""
    for part in shapely.get_parts(shape):
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        rings = [shapely.get_coordinates(ring) for ring in (part.exterior, *part.interiors)]
        codes = [
            np.r_[Outline.MOVETO, np.full(len(ring) - 2, Outline.LINETO), Outline.CLOSEPOLY]
            for ring in rings
        ]
        patch = PathPatch(
            Outline(np.vstack(rings), np.concatenate(codes)),
            facecolor=colour if filled else "none",
            edgecolor="none" if filled else colour,
            linewidth=1.1,
            zorder=2 if filled else 3,
        )
        axes.add_patch(patch)


def pictures_of_geometry(
    reconstruction: Reconstruction, out: Path, *, attribution: str | Iterable[str] = ()
) -> list[Path]:
    """Draw ``geometry-N-registration.png`` and ``geometry-N-cleaning.png`` of the N-th source.

    Args:
        reconstruction: result of the sources.
        out: the folder, created if missing.
        attribution: sources of the data.
    """
    out.mkdir(parents=True, exist_ok=True)
    drawn = []
    for number, source in enumerate(reconstruction.figures, start=1):
        if source.registration is not None and reconstruction.surroundings is not None:
            drawn.append(
                registration_picture(
                    source.registration,
                    reconstruction.surroundings,
                    out / f"geometry-{number}-registration.png",
                    title=f"{source.name}   registered",
                    attribution=attribution,
                )
            )
        if source.cleaning is not None:
            drawn.append(
                cleaning_picture(
                    source.cleaning,
                    out / f"geometry-{number}-cleaning.png",
                    title=f"{source.name}   cleaned",
                    attribution=attribution,
                )
            )
    return drawn
