"""A plan of the weaknesses of a site's inputs, numbered as in the list."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from urbantwin.drawing import style
from urbantwin.drawing.plan_ground import fill
from urbantwin.drawing.plan_style import DARK
from urbantwin.pages import write_page
from urbantwin.weakness import InputCheck

__all__ = ["draw_weakness_plan", "weakness_figure", "write_weakness_page"]

#: Size of the sheet, and of the list at its right, inches.
WIDTH, HEIGHT, LIST = 15.0, 9.4, 5.6
#: Colours by the importance of a finding.
COLOURS = {"much": "#ff5a4f", "some": "#ffb13d", "little": "#7fb8e8"}
#: Maximum number of places of a finding with a number; all places have a dot.
_NUMBERED = 6
#: Minimum distance of a number from another, metres of a plan 300 m wide.
_APART = 9.0
_MARGIN_M = 12.0
#: Letters of a line of the list.
_LETTERS = 74


def draw_weakness_plan(found: InputCheck, path: Path) -> Path:
    """Write the plan as PNG or, by the file's name, as SVG; the same findings, the same bytes."""
    return style.save(weakness_figure(found), path)


def weakness_figure(found: InputCheck) -> Figure:
    """Return a plan of the map with the places of the findings, and the list beside it."""
    figure = style.new_figure(WIDTH, HEIGHT)
    style.title(figure, style.legible(found.site.name) or "Site", "what is weak about its inputs")
    axes = figure.add_axes((0.01, 0.03, (WIDTH - LIST) / WIDTH - 0.02, 0.86))
    style.bare(axes)
    axes.set_aspect("equal")
    west, south, east, north = found.site.region.buffer(_MARGIN_M).bounds
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    _draw_map(axes, found)
    _draw_places(axes, found, scale=(east - west) / 300.0)
    style.north_arrow(axes)
    style.scale_bar(axes)
    _draw_list(figure, found)
    if found.site.osm is not None:
        style.written_attribution(figure, found.attribution)
    return figure


def _draw_map(axes: Axes, found: InputCheck) -> None:
    region = found.site.region
    fill(axes, [region], DARK.ground, edgecolor=DARK.muted, linewidth=1.2, zorder=0)
    place = found.place
    if place is None:
        return
    buildings = [
        item.geometry
        for item in place.features
        if "building" in item.tags and "Polygon" in item.geometry.geom_type
    ]
    fill(axes, buildings, DARK.building, edgecolor=DARK.edge, linewidth=0.5, zorder=1)
    for ways, colour, width in (
        (place.footways, DARK.lanes["sidewalk"], 0.8),
        (place.streets, DARK.lanes["driving"], 3.2),
    ):
        for way in ways:
            for part in shapely.get_parts(way.inside):
                x, y = shapely.get_coordinates(part).T
                axes.plot(x, y, color=colour, lw=width, solid_capstyle="round", zorder=2)


def _draw_places(axes: Axes, found: InputCheck, scale: float) -> None:
    """Draw a dot at every place, and numbers where there is space for them."""
    taken: list[tuple[float, float]] = []
    findings = list(enumerate(found.findings, 1))
    for _, one in reversed(findings):
        xy = np.array([(spot.east_m, spot.north_m) for spot in one.spots]).reshape(-1, 2)
        size = 26 if one.matters != "little" else 12
        axes.scatter(xy[:, 0], xy[:, 1], s=size, color=COLOURS[one.matters], zorder=5, lw=0)
    for number, one in findings:
        shown = 0
        for spot in one.spots:
            at = (spot.east_m, spot.north_m)
            near = [np.hypot(at[0] - x, at[1] - y) < _APART * scale for x, y in taken]
            if shown == _NUMBERED or any(near) or not _is_inside(found, at):
                continue
            taken.append(at)
            shown += 1
            axes.text(
                *at,
                str(number),
                color="#10161d",
                fontsize=9,
                fontweight="bold",
                ha="center",
                va="center",
                zorder=7,
                bbox={"boxstyle": "circle,pad=0.18", "fc": COLOURS[one.matters], "ec": "#10161d"},
            )


def _is_inside(found: InputCheck, at: tuple[float, float]) -> bool:
    return bool(found.site.region.buffer(_MARGIN_M).contains(shapely.Point(at)))


def _draw_list(figure: Figure, found: InputCheck) -> None:
    """Write the list, as far as it fits on the sheet."""
    left, room = (WIDTH - LIST) / WIDTH, 0.022
    top, row = 0.885, 0.0182
    for number, one in enumerate(found.findings, 1):
        problem = textwrap.wrap(style.legible(one.problem), _LETTERS)
        remedy = textwrap.wrap(style.legible(one.remedy), _LETTERS)
        if top - (len(problem) + len(remedy)) * row < 0.05:
            left_over = len(found.findings) - number + 1
            figure.text(left, top, f"and {left_over} more", color=style.MUTED, fontsize=9, va="top")
            break
        colour = COLOURS[one.matters]
        figure.text(left, top, f"{number}.", color=colour, fontsize=9, weight="bold", va="top")
        for lines, ink in ((problem, style.INK), (remedy, style.MUTED)):
            for line in lines:
                figure.text(
                    left + room, top, line, color=ink, fontsize=9, va="top", parse_math=False
                )
                top -= row
        top -= row / 2
    x = left
    for word, colour in COLOURS.items():
        text = f"matters {word}"
        figure.text(x, 0.925, "\u25cf " + text, color=colour, fontsize=9, va="top")
        x += 0.009 * len(text)


#: Places that are listed before the others are folded away.
_OPEN = 5


def write_weakness_page(found: InputCheck, path: Path) -> None:
    """Write the page; it needs no other file, and the same findings give the same bytes."""
    plan = draw_weakness_plan(found, path.with_name(f"{path.stem}.png"))
    template = "drawing/weakness_page.html.j2"
    write_page(path, template, found=found, site=found.site, plan=plan, colours=COLOURS, open=_OPEN)
    plan.unlink()
