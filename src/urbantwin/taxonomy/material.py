"""Materials of triangles and what they do to a beam (table: ``material.csv``).

Between the three wavelengths of the table reflectivity is interpolated along a straight line.
Spectra of plants and wet surfaces are no straight lines between 905 and 1550 nm (water absorbs
about 970, 1200 and 1450 nm), so a sensor at 1064 nm is modelled only roughly; there is none in the
catalogue.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from urbantwin.taxonomy.semantic import table_rows

__all__ = ["WAVELENGTHS_NM", "Material", "material_id", "materials"]

#: The wavelengths of the table, nanometres.
WAVELENGTHS_NM = (865.0, 905.0, 1550.0)


@dataclass(frozen=True)
class Material:
    """A surface.

    Attributes:
        id: its number in ``LabelledMesh.material``.
        name: its name.
        reflectivities: diffuse, 0..1, one per ``WAVELENGTHS_NM``.
        transmission: share of the light that passes through.
        retro: what retroreflectors add to the backscatter, in multiples of white paper: pi times
            the coefficient of retroreflection (EN 12899-1, UN Regulation 3, faced squarely) or, of
            beads, of retroreflected luminance (EN 1436), in cd per m2 and lx.
        retro_law: ``beads``: the same at every angle of incidence; ``sheeting`` and ``prisms``:
            fall as they turn away; ``none``.
        roughness_deg: standard deviation of the slope of its facets; 0: Lambert's surface.
        gets_wet: whether it is ground that a film of water darkens.
        basis: ``measured``, ``modelled`` or ``estimate``.
        source: where the numbers come from, or what to compare an estimate with.
    """

    id: int
    name: str
    reflectivities: tuple[float, float, float]
    transmission: float
    retro: float
    retro_law: str
    roughness_deg: float
    gets_wet: bool
    basis: str
    source: str

    @property
    def reflectivity(self) -> float:
        """Diffuse reflectivity at 905 nm."""
        return self.reflectivities[1]

    def reflectivity_at(self, wavelength_nm: float) -> float:
        """Return the diffuse reflectivity at a wavelength.

        Below 865 nm and above 1550 nm it is that of the nearest of the two, which is as good as
        the table for the catalogue's sensors: the shortest wavelength of any is 850 nm.

        Args:
            wavelength_nm: nanometres.
        """
        table = list(zip(WAVELENGTHS_NM, self.reflectivities, strict=True))
        if wavelength_nm <= table[0][0]:
            return table[0][1]
        for (low, first), (high, second) in pairwise(table):
            if wavelength_nm <= high:
                return first + (second - first) * (wavelength_nm - low) / (high - low)
        return table[-1][1]


@cache
def materials() -> dict[str, Material]:
    """Return every material by name, in the order of their numbers (0, 1, 2, ...)."""
    return {
        row["name"]: Material(
            int(row["id"]),
            row["name"],
            (
                float(row["reflectivity_865"]),
                float(row["reflectivity_905"]),
                float(row["reflectivity_1550"]),
            ),
            float(row["transmission"]),
            float(row["retro"]),
            row["retro_law"],
            float(row["roughness_deg"]),
            row["gets_wet"] == "1",
            row["basis"],
            row["source"],
        )
        for row in table_rows("material.csv")
    }


def material_id(name: str) -> int:
    """Return a material's number; ``KeyError`` where there is no such material."""
    return materials()[name].id
