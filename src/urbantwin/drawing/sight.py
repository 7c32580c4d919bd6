"""A plan of the junction with the areas visible to its sensors and the hidden areas."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from urbantwin.drawing.plan import MARGIN, WIDTH, plan_figure
from urbantwin.drawing.plan_style import DARK
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.sight import CELL_M, RigSight
from urbantwin.roads import RoadNetwork
from urbantwin.roads.model import LaneModel

__all__ = ["sight_figure"]

#: Colours of visible and hidden areas, and their opacity over the plan.
_SEEN, _HIDDEN, _OPACITY = "#35b779", "#e4572e", 0.45
#: Shown around the junction, metres.
_AROUND_M = 15.0


def sight_figure(
    sight: RigSight,
    network: RoadNetwork,
    *,
    model: LaneModel | None = None,
    mesh: LabelledMesh | None = None,
    sensors: Iterable[tuple[str, float, float]] = (),
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Figure:
    """Return a plan of the junction, coloured by whether a sensor has it in sight.

    Args:
        sight: visibility of the sensors.
        network: the lanes.
        model: the lane model, with markings, islands, heads and signs.
        mesh: the static scene: its buildings and plants are drawn in the background.
        sensors: name, x and y of each, site frame, metres.
        title: title of the picture.
        attribution: sources of the data.
    """
    places = [(name, east, north) for name, east, north in sensors]
    shown = shapely.MultiPoint([*sight.points[:, :2], *((x, y) for _, x, y in places)])
    west, south, east, north = shown.bounds
    figure = plan_figure(
        network,
        shapely.box(west - _AROUND_M, south - _AROUND_M, east + _AROUND_M, north + _AROUND_M),
        model=model,
        mesh=mesh,
        sensors=places,
        title=title,
        attribution=attribution,
    )
    axes = figure.axes[0]
    low = sight.points[:, :2].min(axis=0) - CELL_M / 2
    column, row = np.rint((sight.points[:, :2] - low) / CELL_M - 0.5).astype(int).T
    colours = np.zeros((row.max() + 1, column.max() + 1, 4))
    seen = sight.sees.any(axis=0)
    colours[row[seen], column[seen]] = to_rgba(_SEEN, _OPACITY)
    colours[row[~seen], column[~seen]] = to_rgba(_HIDDEN, _OPACITY)
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(
        colours,
        origin="lower",
        extent=(
            low[0],
            low[0] + CELL_M * colours.shape[1],
            low[1],
            low[1] + CELL_M * colours.shape[0],
        ),
        interpolation="nearest",
        zorder=33,
    )
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])
    height = figure.get_figheight()
    words = (
        (0.32, f"{100 * sight.seen:.0f} % of lanes and crossings in sight", _SEEN),
        (0.58, f"{100 - 100 * sight.seen:.0f} % hidden", _HIDDEN),
    )
    for below, text, colour in words:
        figure.text(
            1 - MARGIN / WIDTH,
            1 - below / height,
            text,
            color=colour,
            fontsize=11,
            weight="bold",
            ha="right",
            va="top",
            backgroundcolor=DARK.page,
        )
    return figure
