"""Backscatter of surfaces.

Backscatter is relative to a white (100 %) Lambertian surface at normal incidence: a Lambertian
surface gives ``reflectivity x cos(incidence)`` (Wagner et al. 2006, ISPRS J. Photogramm. 60(2), eq.
14).

**Rough ground** has facets that face the beam at any incidence, and seen from the light source no
facet is in another's shadow. Oren and Nayar 1994 (SIGGRAPH, 239-246, eq. 30) with light and view
along one line give ``reflectivity x (A cos + B sin^2)``, with ``A = 1 - 0.5 s^2 / (s^2 + 0.33)``,
``B = 0.45 s^2 / (s^2 + 0.09)`` and s the standard deviation of the facets' slope, the material
table's ``roughness_deg``. Laser scanners' intensities of rough rock are corrected with it (Carrea
et al. 2016, ISPRS J. Photogramm. 113, 17-29).

**Retroreflectors** add ``retro`` = pi x the coefficient of retroreflection (EN 12899-1, ISO 7591:
cd per lx and m2), hundreds of times that of white paper; it falls with incidence as in EN 12899-1's
table for white sheeting of class RA1: 70 at 5 deg, 30 at 30, 10 at 40. Glass beads in road paint
are made for grazing light and add the same at every angle (pi x the coefficient of retroreflected
luminance of EN 1436).

**Glass** transmits most of a beam (`pane` by the angle, times the material table's value at normal
incidence) and scatters by its dirt alone; its specular reflection returns only within a fraction of
a degree of normal incidence and is neglected. Fresnel's equations for unpolarised light: Born and
Wolf 1999, Principles of Optics, 7th edition, section 1.5.2; refractive indices: water 1.33 at 905
nm and 1.32 at 1550 nm (Hale and Querry 1973, Appl. Opt. 12, 555-563), glass 1.51 (Schott N-BK7).

**Wet ground.** Light scattered inside a water film is reflected at its surface and hits the ground
again, so a wet surface of reflectivity r has ``r / (r + n^2 (1 - r))`` (Angstrom 1925, Geogr. Ann.
7, 323-342; discussed by Lekner and Dorf 1988, Appl. Opt. 27(7), 1278-1280). Fresnel losses at the
film's surface on the way in and out, relative to normal incidence, are reflected away. At 1550 nm
water also absorbs: 10.6 per cm (Hale and Querry: k of 1.3e-4), at 905 nm less than 0.1 per cm.
Glass beads under water do not retroreflect: EN 1436 requires 25 mcd/m2/lx of wet lines (class RW1)
and 100 of dry ones (R2).

**Texture.** Surfaces vary, and laser light speckles: returns scatter from beam to beam by a fifth
to a third on real asphalt (second differences of reflectivity in scans of an OS1-128). The static
world scatters log-normally with `TEXTURE` and mean 1, determined by the beam's number and the
triangle: a fixed sensor sees the same value in every frame. Smooth paint of real cars does not:
neighbouring returns differ by 2 to 4 % (Argoverse 2), so actors have no texture.

**Patches.** Ground is worn, stained and repaired: two places of a real road differ the more the
farther they are apart. `PATCHES` is fitted to the variogram of that OS1-128's reflectivity on a
road from 13 to 18 m, where no ray is lost: 0.25 in the logarithm for neighbours, 0.33 at half a
metre, 0.45 from some metres on; and to 0.54 at 7 m and 0.58 from 12 m on of a VLP-32C and an
OS0-128 in two other streets. The median is the material table's. Dark patches are lost first, which
makes drop-out begin early and grow slowly (`notebook/real_lidar.md`). Both are part of the effect
``noise``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.compiled.patches import add_patches
from urbantwin.lidar.compiled.surfaces import mix, read_actors, read_curves
from urbantwin.lidar.returns.draws import standard_quantiles
from urbantwin.lidar.returns.swallowed import losses, thrown_on
from urbantwin.taxonomy import material_id, materials

__all__ = [
    "FILM_M",
    "N_GLASS",
    "N_WATER",
    "PATCHES",
    "TEXTURE",
    "WET_BEADS",
    "Scatter",
    "film_passes",
    "mirrored",
    "oren_nayar",
    "pane",
    "scatter_of_materials",
    "wet_reflectivity",
]

N_WATER = 1.33
N_GLASS = 1.51

Doubles = NDArray[np.float64]


def mirrored(cosine: Doubles, index: float) -> Doubles:
    """Return the reflectance (N,) of a boundary of air.

    Args:
        cosine: (N,) cosine of incidence in air, 0..1.
        index: refractive index behind the boundary.
    """
    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    return np.asarray((across**2 + along**2) / 2)


def pane(cosine: Doubles, index: float = N_GLASS) -> Doubles:
    """Return the transmittance (N,) of a pane that absorbs nothing.

    Including internal reflections: ``(1 - r) / (1 + r)`` of each polarisation's r.
    """
    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    across = ((cosine - index * inside) / (cosine + index * inside)) ** 2
    along = ((index * cosine - inside) / (index * cosine + inside)) ** 2
    return np.asarray(((1 - across) / (1 + across) + (1 - along) / (1 + along)) / 2)


#: Thickness of a full water film, metres.
FILM_M = 3e-4
#: Share of retroreflection that wet glass beads keep.
WET_BEADS = 0.25

_K_NM = np.array([800.0, 905.0, 1064.0, 1300.0, 1550.0])
_K = np.array([1.25e-7, 4.9e-7, 1.2e-6, 1.1e-5, 1.3e-4])


def wet_reflectivity(dry: Doubles, wavelength_nm: float) -> Doubles:
    """Return the diffuse reflectivity (N,) under a full film, from dry reflectivities (N,)."""
    k = float(np.exp(np.interp(wavelength_nm, _K_NM, np.log(_K))))
    absorbed = np.exp(-2 * FILM_M * 4 * np.pi * k / (wavelength_nm * 1e-9))
    return np.asarray(dry / (dry + N_WATER**2 * (1 - dry)) * absorbed)


def film_passes(cosine: Doubles) -> Doubles:
    """Return the two-way transmittance of the film's surface, relative to normal incidence."""
    passes = 1 - mirrored(cosine, N_WATER)
    return np.asarray((passes / (1 - mirrored(np.ones(1), N_WATER))) ** 2)


#: Standard deviation of the logarithm of backscatter between beams.
TEXTURE = 0.25
#: Sizes of patches of the ground, metres, and the standard deviation of the logarithm of each.
PATCHES = ((0.5, 0.25), (3.0, 0.30), (12.0, 0.33))

_STEPS = 1024
#: EN 12899-1, table for class RA1 (white, 0.33 deg of observation): entrance angle and share.
_SHEETING_DEG = (0.0, 5.0, 30.0, 40.0, 60.0)
_SHEETING = (1.0, 1.0, 30 / 70, 10 / 70, 0.0)
#: UN Regulation 3, class IA: 300, 200 and 100 mcd/lx at 0, 10 and 20 degrees. Beyond it asks for
#: nothing; as between the last two, each 10 degrees are taken to halve it.
_PRISMS_DEG = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 90.0)
_PRISMS = (1.0, 2 / 3, 1 / 3, 1 / 6, 1 / 12, 1 / 24, 1 / 48, 1 / 96, 0.0)

Floats = NDArray[np.float32]


def oren_nayar(roughness_deg: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return A and B (M,) of surfaces with a roughness (M,), degrees."""
    variance = np.radians(roughness_deg) ** 2
    return 1 - 0.5 * variance / (variance + 0.33), 0.45 * variance / (variance + 0.09)


@dataclass(frozen=True, eq=False)
class Scatter:
    """Backscatter and transmission of materials, by material id.

    Attributes:
        diffuse: (M,) diffuse reflectivity; of glass, of its dirt.
        retro: (M,) backscatter added by retroreflectors and glass beads at normal incidence.
        through: (M,) two-way transmission of a pane at normal incidence.
        curve: (M, S) backscatter at S cosines from 0 to 1.
        passes: (M, S) two-way transmission at these cosines.
        texture: standard deviation of the logarithm of backscatter between beams.
        swallows: whether single beams are lost on actors and ground.
    """

    diffuse: Floats
    retro: Floats
    through: Floats
    curve: Floats
    passes: Floats
    texture: float = 0.0
    swallows: bool = False

    def grain(self, beam: NDArray[np.integer], face: NDArray[np.integer]) -> Floats:
        """Return the texture factor (N,) of beams that hit triangles."""
        if self.texture == 0.0:
            return np.ones(len(beam), np.float32)
        drawn = standard_quantiles().take((_mixed(beam, face) >> np.uint64(48)).astype(np.int64))
        return np.asarray(np.exp(self.texture * drawn - self.texture**2 / 2), np.float32)

    def of_actors(
        self,
        beam: NDArray[np.int32],
        face: NDArray[np.int32],
        material: NDArray[np.uint8],
        cosine: Floats,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return backscatter and two-way transmission of actors' triangles (N,).

        Args:
            beam: (N,) beam numbers.
            face: (N,) triangles that they hit: see `swallowed`.
            material: (N,) materials of these.
            cosine: (N,) cosines of incidence.
        """
        back, through = np.empty(len(beam)), np.empty(len(beam))
        lost = losses(swallows=self.swallows)
        read_actors(self.curve, self.passes, beam, face, material, cosine, lost, back, through)
        return back, through

    def patches(self, places: NDArray[np.float64]) -> Floats:
        """Return the patch factor (N,) of ground at places (N, 3), site frame."""
        logarithm = np.zeros(len(places))
        if self.texture > 0:
            east, north = np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1])
            for number, (size_m, sigma) in enumerate(PATCHES):
                add_patches(east, north, number, size_m, sigma, standard_quantiles(), logarithm)
        return np.exp(logarithm).astype(np.float32)

    def thrown_on(self, places: NDArray[np.float64], cosine: NDArray[np.floating]) -> Floats:
        """Return the remaining share (N,) of the ground's backscatter: see `swallowed`.

        Args:
            places: (N, 3) site frame.
            cosine: (N,) cosines of incidence.
        """
        if not self.swallows:
            return np.ones(len(places), np.float32)
        return thrown_on(places, cosine)

    @property
    def ground_spread(self) -> float:
        """Standard deviation of the logarithm of the ground's backscatter."""
        if self.texture == 0.0:
            return 0.0
        return float(np.sqrt(self.texture**2 + sum(sigma**2 for _, sigma in PATCHES)))

    def backscatter(
        self, material: NDArray[np.uint8], cosine: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the backscatter (N,) of materials (N,) at cosines of incidence (N,).

        Above 1 where a retroreflector returns more than white paper.
        """
        return self._read(self.curve, material, cosine)

    def transmission(
        self, material: NDArray[np.uint8], cosine: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the two-way transmission (N,) of materials (N,)."""
        return self._read(self.passes, material, cosine)

    @staticmethod
    def _read(
        table: Floats, material: NDArray[np.uint8], cosine: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Interpolate a table linearly between its cosines."""
        values = np.empty(len(cosine))
        kinds = np.asarray(np.broadcast_to(material, cosine.shape), np.uint8, order="C")
        read_curves(table, kinds, np.ascontiguousarray(cosine, np.float32), values)
        return values


@cache
def scatter_of_materials(
    wavelength_nm: float,
    wet_ground: float = 0.0,
    *,
    retroreflection: bool = True,
    glass: bool = True,
    texture: bool = False,
    swallows: bool = False,
    reflectivity: tuple[tuple[str, float], ...] = (),
) -> Scatter:
    """Return backscatter and transmission of every material.

    Args:
        wavelength_nm: wavelength of the laser.
        wet_ground: share of the ground that a water film covers, 0 to 1.
        retroreflection: whether retroreflectors and beads retroreflect.
        glass: whether glass is transparent; otherwise it is an opaque surface.
        texture: whether backscatter varies over a surface.
        swallows: whether single beams are lost on actors and ground.
        reflectivity: materials, and factors on their reflectivity.
    """
    table = list(materials().values())
    cosine = np.linspace(0, 1, _STEPS + 1)
    passes_squarely = np.array([entry.transmission if glass else 0.0 for entry in table])
    diffuse = np.array([entry.reflectivity_at(wavelength_nm) for entry in table])
    diffuse *= 1 - passes_squarely
    a, b = oren_nayar(np.array([entry.roughness_deg for entry in table]))
    shape = a[:, None] * cosine + b[:, None] * (1 - cosine**2)

    wet = np.array([wet_ground if entry.gets_wet else 0.0 for entry in table])[:, None]
    dry = diffuse[:, None] * shape
    under_film = wet_reflectivity(diffuse, wavelength_nm)[:, None] * shape * film_passes(cosine)
    retro = np.array([entry.retro if retroreflection else 0.0 for entry in table])
    turned = np.degrees(np.arccos(cosine))
    laws = {
        "sheeting": np.interp(turned, _SHEETING_DEG, _SHEETING),
        "prisms": np.interp(turned, _PRISMS_DEG, _PRISMS),
    }
    falls = np.stack([laws.get(entry.retro_law, np.ones_like(turned)) for entry in table])
    back = retro[:, None] * falls * (1 - wet * (1 - WET_BEADS))
    relative = pane(cosine) / pane(np.ones(1))
    factor = np.ones(len(table))
    for name, times in reflectivity:
        factor[material_id(name)] = times
    return Scatter(
        (diffuse * factor).astype(np.float32),
        (retro * factor).astype(np.float32),
        (passes_squarely**2).astype(np.float32),
        ((dry * (1 - wet) + under_film * wet + back) * factor[:, None]).astype(np.float32),
        ((passes_squarely[:, None] * relative) ** 2).astype(np.float32),
        TEXTURE if texture else 0.0,
        swallows,
    )


def _mixed(beam: NDArray[np.integer], face: NDArray[np.integer]) -> NDArray[np.uint64]:
    """Return random bits (N,) of beams that hit triangles."""
    bits = np.empty(len(beam), np.uint64)
    mix(np.ascontiguousarray(beam, np.int32), np.ascontiguousarray(face, np.int32), bits)
    return bits
