"""What became of a correction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import shapely

from urbantwin.site.corrections.read import Correction

__all__ = ["Outcome"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a correction.

    Attributes:
        correction: which one.
        applied: whether anything is different because of it.
        told: what is different, or why nothing is.
        at: where on the plan, site frame.
    """

    correction: Correction
    applied: bool
    told: str
    at: Sequence[shapely.Geometry] = ()

    @property
    def shapes(self) -> Sequence[shapely.Geometry]:
        """Return where it is shown: where it was done, else where it was drawn."""
        return self.at or self.correction.shapes
