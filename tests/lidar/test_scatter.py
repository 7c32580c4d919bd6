"""What surfaces send back, against the laws and standards that are cited."""

import numpy as np
import pytest
from scipy.stats import kstest, norm

from urbantwin.lidar.returns import scatter_of_materials
from urbantwin.lidar.returns.scatter import TEXTURE, mirrored, pane
from urbantwin.taxonomy import material_id, materials

COSINE = np.linspace(0.01, 1, 200)


def back(name, cosine=COSINE, wavelength=905.0, wet=0.0, **options):
    number = np.full(len(cosine), material_id(name), np.uint8)
    return scatter_of_materials(wavelength, wet, **options).backscatter(number, cosine)


@pytest.mark.parametrize("name", ["plaster", "brick", "cloth", "metal-painted"])
def test_smooth_walls_follow_lambert(name):
    np.testing.assert_allclose(back(name), materials()[name].reflectivity * COSINE, rtol=1e-4)


def test_rough_ground_is_a_landscape_of_lambertian_facets():
    """By Monte Carlo: Gaussian slopes both ways, each facet seen by the area that it shows.

    Nothing is in shadow for who looks from the lamp. Oren and Nayar's equation is a fit to such.
    """
    rng = np.random.default_rng(0)
    asphalt = materials()["asphalt"]
    slopes = rng.normal(0, np.tan(np.radians(asphalt.roughness_deg)), (400_000, 2))
    facets = np.column_stack([-slopes, np.ones(len(slopes))])
    for angle in np.radians([0.0, 30.0, 60.0, 75.0]):
        shown = np.maximum(facets @ [np.sin(angle), 0, np.cos(angle)], 0)
        cosine = shown / np.linalg.norm(facets, axis=1)
        expected = (cosine * shown).mean() / shown.mean()
        ours = back("asphalt", np.cos([angle]))[0] / asphalt.reflectivity
        assert ours == pytest.approx(expected, abs=0.05)


def test_white_sheeting_is_seventy_candela_times_pi_and_falls_as_the_standard_says():
    """EN 12899-1, class RA1, white: 70, 30 and 10 cd/lx/m2 at 5, 30 and 40 degrees."""
    ours = back("retroreflector", np.cos(np.radians([5.0, 30.0, 40.0])))
    np.testing.assert_allclose(ours / np.pi, [70, 30, 10], rtol=0.06)
    plain = back("retroreflector", retroreflection=False)
    np.testing.assert_allclose(plain, 0.6 * COSINE, rtol=1e-4)


def test_a_reflex_reflector_of_40_cm2_gives_what_un_regulation_3_asks_for_and_falls_so():
    """Class IA, red: 300, 200 and 100 mcd/lx at 0, 10 and 20 degrees; white four times that."""
    ours = back("reflex-reflector", np.cos(np.radians([0.0, 10.0, 20.0, 90.0]))) / np.pi * 0.004
    np.testing.assert_allclose(ours[:3] / 4, [0.3, 0.2, 0.1], rtol=0.05)
    assert ours[3] < 1e-3


@pytest.mark.parametrize("index", [1.33, 1.51])
def test_fresnel_at_the_angles_that_are_known_in_closed_form(index):
    squarely = ((index - 1) / (index + 1)) ** 2
    assert mirrored(np.ones(1), index)[0] == pytest.approx(squarely)
    assert mirrored(np.zeros(1), index)[0] == pytest.approx(1)
    # At Brewster's angle nothing of one polarisation is mirrored.
    brewster = np.cos(np.arctan([index]))
    other = ((index**2 - 1) / (index**2 + 1)) ** 2
    assert mirrored(brewster, index)[0] == pytest.approx(other / 2)
    assert pane(np.ones(1), index)[0] == pytest.approx(2 * index / (index**2 + 1))


def test_glass_passes_less_the_flatter_it_is_met_and_nothing_when_turned_off():
    number = np.full(len(COSINE), material_id("glass"), np.uint8)
    passes = scatter_of_materials(905.0).transmission(number, COSINE)
    glass = materials()["glass"]
    assert passes[-1] == pytest.approx(glass.transmission**2, rel=1e-4)
    assert (np.diff(passes) >= -1e-6).all()
    assert passes[0] < 0.05
    opaque = scatter_of_materials(905.0, glass=False)
    assert (opaque.transmission(number, COSINE) == 0).all()
    np.testing.assert_allclose(
        opaque.backscatter(number, COSINE), glass.reflectivity * COSINE, rtol=1e-4
    )


@pytest.mark.parametrize("name", ["asphalt", "paving", "soil"])
def test_wet_ground_is_darker_by_angstroms_law(name):
    """Squarely; at a slant the film mirrors more away; at 1550 nm water absorbs as well."""
    dry = materials()[name].reflectivity
    expected = dry / (dry + 1.33**2 * (1 - dry)) / dry
    ratio = back(name, wet=1.0) / back(name)
    assert ratio[-1] == pytest.approx(expected, rel=0.01)
    assert (np.diff(ratio) > -1e-5).all()
    assert ratio[10] < 0.5 * ratio[-1]
    far = back(name, wavelength=1550.0, wet=1.0) / back(name, wavelength=1550.0)
    assert far[-1] < 0.7 * ratio[-1]
    half = back(name, wet=0.5)
    np.testing.assert_allclose(half, (back(name) + back(name, wet=1.0)) / 2, rtol=1e-5)


def test_walls_and_vehicles_do_not_get_wet():
    for name in ("plaster", "metal-painted", "glass", "retroreflector"):
        np.testing.assert_array_equal(back(name, wet=1.0), back(name))


def test_beads_under_water_return_a_quarter():
    """EN 1436: class RW1 (wet) 25 where class R2 (dry) has 100 mcd/m2/lx."""
    grazing = np.array([1e-4])
    assert back("road-paint", grazing, wet=1.0)[0] == pytest.approx(0.06 / 4, rel=0.05)


def test_texture_is_log_normal_about_one_and_the_same_whenever_asked():
    scatter = scatter_of_materials(905.0, texture=True)
    beam, face = np.divmod(np.arange(400_000, dtype=np.int32), 4)
    grain = scatter.grain(beam, face).astype(float)
    assert grain.mean() == pytest.approx(1, abs=0.003)
    assert kstest(np.log(grain), norm(-(TEXTURE**2) / 2, TEXTURE).cdf).pvalue > 1e-3
    # Neither neighbouring beams nor neighbouring triangles have to do with each other.
    for shift in (1, 4, 2048):
        assert abs(np.corrcoef(grain[shift:], grain[:-shift])[0, 1]) < 0.006
    np.testing.assert_array_equal(scatter.grain(beam[::-1], face[::-1]), grain[::-1])
    assert (scatter_of_materials(905.0).grain(beam, face) == 1).all()
