"""Static obstacles for inserted actors: walls, posts, furniture of the scene."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.geometry import DownwardProbe
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.obstacles import Obstacles
from urbantwin.traffic.paths.overlap import TOUCH_M, rows_that_overlap
from urbantwin.twin import Twin

__all__ = ["Solid"]


class Solid:
    """The static obstacles of a twin, and its ground.

    Args:
        twin: the twin.
    """

    def __init__(self, twin: Twin) -> None:
        self.twin = twin

    @cached_property
    def _obstacles(self) -> Obstacles:
        return Obstacles(self.twin.mesh)

    @cached_property
    def _ground(self) -> DownwardProbe:
        return DownwardProbe(self.twin.ground_mesh)

    def ground(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height (N,) of the highest ground at points (N, 2); nan if there is none."""
        top = float(self.twin.mesh.vertices[:, 2].max()) + 1.0
        return self._ground.height_below(np.column_stack([xy, np.full(len(xy), top)]))

    def met(
        self,
        xy: NDArray[np.float64],
        yaw: NDArray[np.float64],
        size: tuple[float, float, float],
    ) -> NDArray[np.bool_]:
        """Return whether a body at given poses overlaps a static obstacle (N,).

        Args:
            xy: (N, 2) centres of the body, metres.
            yaw: (N,) headings, rad.
            size: length, width and height, metres.
        """
        half = np.maximum(np.array(size[:2]) / 2 - TOUCH_M, 0.01)
        boxes = PlanBoxes(np.zeros(len(xy), np.int64), xy, yaw, np.tile(half, (len(xy), 1)))
        overlaps = np.zeros(len(xy), np.bool_)
        z, height = np.nan_to_num(self.ground(xy)), np.full(len(xy), size[2])
        overlaps[self._obstacles.beside(boxes, z, height)[:, 0]] = True
        return overlaps

    def met_by(self, rows: pa.Table, step_s: float) -> str:
        """Describe the first overlap of actors with the scene; return an empty text without one.

        Args:
            rows: rows of the table of actors, by time.
            step_s: time between steps, seconds.
        """
        tracks = rows["track"].to_numpy()
        overlaps = rows_that_overlap([rows], rows.slice(0, 0), step_s, self._obstacles, tracks)
        if not len(overlaps.hits):
            return ""
        row = int(overlaps.hits[0])
        pose = {name: rows[name][row].as_py() for name in ("class", "time_s", "x", "y")}
        where = f"{pose['x']:.1f}, {pose['y']:.1f} at {pose['time_s']:.1f} s"
        return f"its {pose['class']} would come into a {overlaps.what[0]} at {where}"
