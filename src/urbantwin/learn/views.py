"""Test-time augmentation: views of a frame, mirrored and rotated by quarter turns.

The mean of the outputs over several views is better than that of one, although the network was
trained on random rotations (Krizhevsky, Sutskever and Hinton 2012, section 4.1, "ImageNet
Classification with Deep Convolutional Neural Networks").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_VIEWS", "VIEWS", "View"]

#: Rows of a class's output (`heads`): offset of the centre, doubled heading, direction.
_EAST_OF_MIDDLE, _NORTH_OF_MIDDLE, _COSINE, _SINE, _EAST, _NORTH = 1, 2, 7, 8, 9, 10


@dataclass(frozen=True)
class View:
    """A reflection of y, then a counter-clockwise rotation.

    Attributes:
        quarters: number of quarter turns.
        mirrored: whether y is mirrored first.
    """

    quarters: int = 0
    mirrored: bool = False

    def points(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Transform points (N, 3+) into the view."""
        seen = points.copy()
        if self.mirrored:
            seen[:, 1] *= -1
        for _ in range(self.quarters):
            seen[:, 0], seen[:, 1] = -seen[:, 1], seen[:, 0].copy()
        return seen

    def back(self, said: NDArray[np.float32]) -> NDArray[np.float32]:
        """Transform the output of a class (`heads.OUTPUTS`, rows, columns) back to the frame."""
        for _ in range(self.quarters):
            told = np.transpose(said, (0, 2, 1))[:, ::-1]
            said = told.copy()
            said[_EAST_OF_MIDDLE], said[_NORTH_OF_MIDDLE] = (
                told[_NORTH_OF_MIDDLE],
                -told[_EAST_OF_MIDDLE],
            )
            said[_COSINE], said[_SINE] = -told[_COSINE], -told[_SINE]
            said[_EAST], said[_NORTH] = told[_NORTH], -told[_EAST]
        if self.mirrored:
            said = said[:, ::-1].copy()
            for row in (_NORTH_OF_MIDDLE, _SINE, _NORTH):
                said[row] *= -1
        return said


#: Ordered so that the first n differ most; the first is the frame itself.
VIEWS = tuple(
    View(quarters, mirrored)
    for quarters, mirrored in (
        (0, False), (2, True), (1, False), (3, True), (2, False), (0, True), (3, False), (1, True),
    )
)  # fmt: skip
MOST_VIEWS = len(VIEWS)
