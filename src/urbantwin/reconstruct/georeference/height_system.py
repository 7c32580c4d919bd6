"""Height systems: their datum, the site's z = 0 in them, and transformations between them.

Ellipsoidal heights and heights above the sea differ by the geoid's: -106 to +85 m. A transform
between them is made only with the grid of the geoid at hand: never a "ballpark" one, which leaves
heights as they are.
"""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS, GeographicCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import AreaOfInterest, TransformerGroup

from urbantwin.site import DemGrid

__all__ = [
    "HeightSystem",
    "NoGridError",
    "SiteHeights",
    "area_of",
    "geoid_height",
    "heights_between",
]


class NoGridError(Exception):
    """Heights cannot be transformed; its text names what is missing."""


@dataclass(frozen=True, eq=False)
class HeightSystem:
    """What heights of a source are above.

    Attributes:
        datum: a vertical CRS, or a three-dimensional geographic CRS for heights above its
            ellipsoid.
    """

    datum: CRS

    @classmethod
    def of(cls, crs: CRS | None) -> HeightSystem | None:
        """Return the heights of a CRS, or ``None`` where it has none or does not say of what."""
        if crs is None:
            return None
        if crs.is_bound and crs.source_crs is not None:
            return cls.of(crs.source_crs)
        if crs.is_vertical and not crs.is_compound:
            return cls(crs)
        plan = crs
        if crs.is_compound:
            plan, vertical = crs.sub_crs_list[0], crs.sub_crs_list[-1]
            # As GeoTIFF keys and LAS files name heights above the ellipsoid.
            if "ellips" not in vertical.name.lower():
                return cls(vertical)
        elif len(crs.axis_info) != 3:
            return None
        base = plan.geodetic_crs
        return None if base is None else cls(_geographic_3d(base))

    @property
    def is_ellipsoidal(self) -> bool:
        """Whether heights are above an ellipsoid, and not above a geoid or the sea."""
        return not self.datum.is_vertical

    @property
    def name(self) -> str:
        """What it is called."""
        if self.is_ellipsoidal:
            return f"ellipsoidal heights ({self.datum.name})"
        return self.datum.name

    @cached_property
    def metres(self) -> float:
        """Metres per unit, negative where the axis points down."""
        axis = self.datum.axis_info[-1]
        return float(axis.unit_conversion_factor) * (-1.0 if axis.direction == "down" else 1.0)

    def same_datum(self, other: HeightSystem) -> bool:
        """Whether heights of both are above the same surface, in whatever unit."""
        if self.is_ellipsoidal != other.is_ellipsoidal:
            return False
        a, b = self.datum.datum, other.datum.datum
        if a is None or b is None:
            return self.datum == other.datum
        # A datum ensemble (WGS 84) and its realisations differ by centimetres.
        first, second = (_plain(item.name) for item in (a, b))
        return a == b or first == second

    def in_space(self) -> CRS:
        """Return the system as a CRS of longitude, latitude and height."""
        if self.is_ellipsoidal:
            return self.datum
        return CompoundCRS(f"WGS 84 + {self.datum.name}", [CRS("EPSG:4326"), self.datum])


@dataclass(frozen=True, eq=False)
class SiteHeights:
    """The anchor's ground in the heights of the source that says what it is.

    Attributes:
        anchor_m: height of the anchor's ground, metres.
        datum: of these heights; ``None`` where the source does not say.
        name: of the source.
    """

    anchor_m: float
    datum: HeightSystem | None
    name: str

    @classmethod
    def of_dem(cls, grid: DemGrid, name: str) -> SiteHeights:
        """Return what a DEM says of the anchor's ground."""
        crs = CRS.from_wkt(grid.vertical) if grid.vertical else None
        return cls(grid.anchor_height_m, HeightSystem.of(crs), name)

    def as_report(self) -> dict[str, object]:
        """Return the entry of a report."""
        return {
            "anchor_m": round(self.anchor_m, 3),
            "datum": "not stated" if self.datum is None else self.datum.name,
            "of": self.name,
        }


def area_of(longitude: float, latitude: float) -> AreaOfInterest:
    """Return the surroundings of a place, for the choice of transformations."""
    return AreaOfInterest(
        max(-180.0, longitude - 0.02),
        max(-90.0, latitude - 0.02),
        min(180.0, longitude + 0.02),
        min(90.0, latitude + 0.02),
    )


def heights_between(
    lonlat: NDArray[np.float64],
    heights: NDArray[np.float64],
    a: HeightSystem,
    b: HeightSystem,
) -> tuple[NDArray[np.float64], str]:
    """Transform heights from one system to another.

    Args:
        lonlat: (N, 2) degrees, WGS84.
        heights: (N,) in the unit of ``a``.
        a: what they are above.
        b: what they are to be above.

    Returns:
        Heights (N,) in metres above ``b``, and what was done, with its accuracy.

    Raises:
        NoGridError: there is no way, or the grid that it needs is not at hand.
    """
    if a.same_datum(b):
        return heights * a.metres, f"none: both are {b.name}"
    area = area_of(*lonlat.mean(axis=0))
    group = _operations(a.in_space(), b.in_space(), area)
    missing: list[str] = []
    if group is not None:
        missing = [
            grid.short_name
            for operation in group.unavailable_operations[:3]
            for grid in operation.grids
            if not grid.available
        ]
        for operation in group.transformers:
            _, _, out = operation.transform(lonlat[:, 0], lonlat[:, 1], heights)
            out = np.asarray(out, np.float64)
            if np.isfinite(out).all():
                # PROJ says -1 where it does not know.
                stated = operation.accuracy or 0.0
                accuracy = f"{stated:g} m" if stated > 0 else "not stated"
                return out * b.metres, f"{operation.description} (accuracy {accuracy})"
    for system, other, sign in ((a, b, 1.0), (b, a, -1.0)):
        if _is_egm96(system) and other.is_ellipsoidal:
            geoid = geoid_height(lonlat)
            if np.isfinite(geoid).all():
                metres = heights * a.metres + sign * geoid
                return metres, "EGM96 geoid of 15 minutes, egm96_15.gtx (accuracy 1 m)"
    if not missing:
        raise NoGridError("PROJ knows no transformation between them")
    names = ", ".join(dict.fromkeys(missing))
    raise NoGridError(f"PROJ's grid {names} is not installed")


def geoid_height(lonlat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how high (N,) the EGM96 geoid lies above the WGS84 ellipsoid, metres; nan: not known.

    The grid of 15 minutes that SUMO brings along, in one of two packages; good to about a metre.
    """
    out = np.full(len(lonlat), np.nan)
    specs = [importlib.util.find_spec(name) for name in ("sumo", "sumo_data")]
    for folder in (x for spec in specs if spec for x in spec.submodule_search_locations or ()):
        grid = Path(folder) / "data" / "proj" / "egm96_15.gtx"
        if grid.is_file():
            pipeline = f'+proj=vgridshift +grids="{grid}" +multiplier=1'
            try:
                transformer = Transformer.from_pipeline(pipeline)
                out = np.asarray(
                    transformer.transform(lonlat[:, 0], lonlat[:, 1], np.zeros(len(lonlat)))[2]
                )
            except ProjError:
                continue
    return np.where(np.isfinite(out), out, np.nan)


def _operations(a: CRS, b: CRS, area: AreaOfInterest) -> TransformerGroup | None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the best is not at hand: looked at by the caller
        try:
            return TransformerGroup(
                a, b, always_xy=True, area_of_interest=area, allow_ballpark=False
            )
        except (CRSError, ProjError):
            return None


def _geographic_3d(base: CRS) -> CRS:
    """Return longitude, latitude and height of the datum of a geodetic CRS."""
    if not base.is_geocentric:
        return base.to_3d()
    if base == CRS("EPSG:4978"):
        return CRS("EPSG:4979")
    return GeographicCRS(base.name, base.datum).to_3d()


def _is_egm96(system: HeightSystem) -> bool:
    return not system.is_ellipsoidal and "egm96" in _plain(system.datum.name)


def _plain(name: str) -> str:
    text = "".join(one for one in name.lower() if one.isalnum())
    return "wgs84" if text.startswith(("worldgeodeticsystem1984", "wgs84")) else text
