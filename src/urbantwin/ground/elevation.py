"""The elevation of the bare earth as a grid in the site frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.errors import InputError

__all__ = ["Elevation"]

_EXPECTED = "a twin's grid of heights"
#: The arrays in the file, in metres: places and heights within what the Earth has.
_FORM = {
    "raw": ArrayOf("f8", ("rows", "columns"), least=-20_000, most=20_000),
    "place": ArrayOf("f8", ("P",), least=-1e7, most=1e7),
}


@dataclass(frozen=True, eq=False)
class Elevation:
    """Heights above the anchor's ground.

    Attributes:
        west, south: position of the first cell's centre, site frame, metres.
        step: cell size, metres.
        raw: (rows from south to north, columns from west to east) float64, metres.
        source_step: cell size of the model that the grid was resampled from, metres; 0 where the
            grid is the source.
    """

    west: float
    south: float
    step: float
    raw: NDArray[np.float64]
    source_step: float = 0.0

    @property
    def detail(self) -> float:
        """Size of the smallest things that the heights can show, metres."""
        return max(self.step, self.source_step)

    @classmethod
    def flat(cls) -> Elevation:
        """Return a level plain at the anchor's height."""
        return cls(-1.0, -1.0, 1.0, np.zeros((3, 3)))

    @property
    def is_flat(self) -> bool:
        """Whether every height is the same."""
        return bool(np.ptp(self.raw) == 0)

    def raw_at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return bare-earth heights (N,) at (N, 2) points, bilinear; the border's value beyond."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        rows = (points[:, 1] - self.south) / self.step
        columns = (points[:, 0] - self.west) / self.step
        return np.asarray(map_coordinates(self.raw, [rows, columns], order=1, mode="nearest"))

    def save(self, path: Path) -> None:
        """Write a ``.npz``; the same grid gives the same bytes."""
        np.savez_compressed(
            path,
            raw=self.raw,
            place=np.array([self.west, self.south, self.step, self.source_step], np.float64),
        )

    @classmethod
    def load(cls, path: Path) -> Elevation:
        """Read what ``save`` wrote.

        Raises:
            InputError: missing, damaged, or no grid of heights.
        """
        data = read_arrays(path, _EXPECTED, _FORM)
        place = data["place"].tolist()
        # Older grids do not say what they were resampled from.
        if len(place) not in (3, 4) or place[2] <= 0 or min(place[3:], default=0) < 0:
            problem = "is not the place of a grid"
            raise InputError(problem, file=path, place="place", expected=_EXPECTED)
        if not data["raw"].size:
            raise InputError("has no heights", file=path, place="raw", expected=_EXPECTED)
        west, south, step, *source = place
        return cls(west, south, step, data["raw"], *source[:1])
