"""A place from above as measured by its sensors, to draw streets on: a raster with a world file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps, image
from scipy.ndimage import gaussian_filter

from urbantwin.traffic.observed import Observation

__all__ = ["draw_observed_place"]

#: Size of a pixel, metres; height difference from the surroundings at which the ground is black or
#: white (a curb has 0.12 m); and their radius.
PIXEL_M, RELIEF_M, AROUND_M = 0.1, 0.15, 6.0


def draw_observed_place(folder: Path, found: Observation) -> None:
    """Write ``above.png`` and ``above.pgw``, which gives its position to map programs.

    Grey is the ground, lighter where it is higher than its surroundings; blue to yellow are the
    points that moved, from the first frame to the last.

    Args:
        folder: output folder.
        found: moving points, and the ground.
    """
    grid = found.ground.grid
    heights = found.ground.heights
    known = np.isfinite(heights)
    weight = gaussian_filter(known.astype(float), AROUND_M / grid.step)
    level = gaussian_filter(np.where(known, heights, 0.0), AROUND_M / grid.step)
    relief = np.where(known, heights, np.nan) - level / np.maximum(weight, 1e-6)
    times = max(1, round(grid.step / PIXEL_M))
    grey = np.clip(0.5 + relief / (2 * RELIEF_M), 0.0, 1.0)
    shade = np.repeat(np.repeat(np.where(np.isnan(grey), 0.0, grey), times, 0), times, 1)
    picture = np.stack([shade] * 3, axis=2)
    step = grid.step / times
    column = ((found.trails[:, 0] - grid.west) / step + times / 2).astype(int)
    row = ((found.trails[:, 1] - grid.south) / step + times / 2).astype(int)
    inside = (column >= 0) & (row >= 0) & (row < shade.shape[0]) & (column < shade.shape[1])
    colours = colormaps["plasma"](found.trails[inside, 2] / max(found.frames - 1, 1))[:, :3]
    picture[row[inside], column[inside]] = colours
    image.imsave(folder / "above.png", picture[::-1])
    # Centre of the upper left pixel; the grid's nodes are centres of their cells.
    west = grid.west + (1 - times) / 2 * step
    north = grid.south + (shade.shape[0] - 1 + (1 - times) / 2) * step
    (folder / "above.pgw").write_text(f"{step}\n0\n0\n{-step}\n{west}\n{north}\n", encoding="utf-8")
