"""What z = 0 of a site is in the heights of a source."""

from __future__ import annotations

from dataclasses import dataclass

from pyproj import CRS

__all__ = ["SiteHeights"]


@dataclass(frozen=True, eq=False)
class SiteHeights:
    """The anchor's ground in the heights of the source that says what it is.

    Attributes:
        anchor_m: height of the anchor's ground, metres.
        datum: a vertical CRS, or a three-dimensional geographic one for heights above an
            ellipsoid; ``None`` where the source does not say.
        name: of the source.
    """

    anchor_m: float
    datum: CRS | None
    name: str
