"""Height systems: datum, the site's z = 0, and transformations between systems.

Ellipsoidal heights and heights above sea level differ by the geoid's: -106 to +85 m. A
transformation between them requires the geoid grid; "ballpark" transformations, which leave heights
unchanged, are never used.
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
    """Heights cannot be transformed; the message names the missing grid."""


@dataclass(frozen=True, eq=False)
class HeightSystem:
    """The reference surface of a source's heights.

    Attributes:
        datum: a vertical CRS, or a three-dimensional geographic CRS for ellipsoidal heights.
    """

    datum: CRS

    @classmethod
    def of(cls, crs: CRS | None) -> HeightSystem | None:
        """Return the height system of a CRS, or ``None`` if it has none or does not state it."""
        if crs is None:
            return None
        if crs.is_bound and crs.source_crs is not None:
            return cls.of(crs.source_crs)
        if crs.is_vertical and not crs.is_compound:
            return cls(crs)
        plan = crs
        if crs.is_compound:
            plan, vertical = crs.sub_crs_list[0], crs.sub_crs_list[-1]
            # GeoTIFF keys and LAS files name ellipsoidal heights so.
            if "ellips" not in vertical.name.lower():
                return cls(vertical)
        elif len(crs.axis_info) != 3:
            return None
        base = plan.geodetic_crs
        return None if base is None else cls(_geographic_3d(base))

    @property
    def is_ellipsoidal(self) -> bool:
        """Whether heights are above an ellipsoid instead of a geoid or sea level."""
        return not self.datum.is_vertical

    @property
    def name(self) -> str:
        """Name of the system."""
        if self.is_ellipsoidal:
            return f"ellipsoidal heights ({self.datum.name})"
        return self.datum.name

    @cached_property
    def metres(self) -> float:
        """Metres per unit, negative where the axis points down."""
        axis = self.datum.axis_info[-1]
        return float(axis.unit_conversion_factor) * (-1.0 if axis.direction == "down" else 1.0)

    def same_datum(self, other: HeightSystem) -> bool:
        """Return whether both systems refer to the same surface, in any unit."""
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
    """The height of the anchor's ground, in the height system of the source that states it.

    Attributes:
        anchor_m: height of the anchor's ground, metres.
        datum: height system; ``None`` if the source does not state it.
        name: name of the source.
    """

    anchor_m: float
    datum: HeightSystem | None
    name: str

    @classmethod
    def of_dem(cls, grid: DemGrid, name: str) -> SiteHeights:
        """Return the height of the anchor's ground in a DEM."""
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
    """Return the surroundings of a position, to select transformations."""
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
        a: the source system.
        b: the target system.

    Returns:
        Heights (N,) in metres above ``b``, and a description with the accuracy.

    Raises:
        NoGridError: there is no transformation, or its grid is missing.
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
                # PROJ returns -1 if unknown
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
    """Return the height (N,) of the EGM96 geoid above the WGS84 ellipsoid, metres; nan if unknown.

    Uses the 15 minute grid of SUMO's packages, which is accurate to about a metre.
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
        warnings.simplefilter("ignore")  # a missing best grid is handled by the caller
        try:
            return TransformerGroup(
                a, b, always_xy=True, area_of_interest=area, allow_ballpark=False
            )
        except (CRSError, ProjError):
            return None


def _geographic_3d(base: CRS) -> CRS:
    """Return the geographic 3D CRS of a geodetic CRS's datum."""
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
