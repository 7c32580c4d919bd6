"""Returns against the formulas and tables that they are stated to follow."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import kstest, truncnorm

from urbantwin.lidar.catalogue import sensor, sensor_names
from urbantwin.lidar.returns import (
    ReturnModel,
    draw,
    scatter_of_materials,
    standard_noise,
    truncated_noise,
)
from urbantwin.lidar.returns.swallowed import FAINTEST
from urbantwin.site.rig import Effects
from urbantwin.taxonomy import material_id


@pytest.fixture(scope="module")
def os1(ground_mesh, rig_of):
    """OS1-128 on a pole: 10 % seen to 45 m, as its datasheet says."""
    return rig_of(ground_mesh(), {}).sensors[0]


#: What sunlight adds to the noise, so that 80 % at 100 m is as strong as 10 % at 45 m.
SUN = brentq(lambda b: np.sqrt((1 + 0.8 * b) / (1 + 0.1 * b)) - 8 * (45 / 100) ** 2, 0, 100)


def strength_of(range_m, reflectivity=0.1):
    """Worked out apart: the datasheet's target at 45 m is 1."""
    noise = np.sqrt((1 + SUN * reflectivity) / (1 + SUN * 0.1))
    return reflectivity / 0.1 * (45.0 / range_m) ** 2 / noise


def level_shares(model, backscatter, range_m, rays=200_000):
    """The share of rays that return, by drawing."""
    draws = draw(5, 0, 17, rays)
    level = model.detection_level(
        np.full(rays, backscatter, np.float32), np.full(rays, range_m, np.float32)
    )
    return (draws.detection < level).mean()


def test_datasheet_target_at_datasheet_range_returns_nine_times_in_ten(os1):
    assert (os1.sensor.reference_reflectivity, os1.sensor.reference_range_m) == (0.1, 45)
    assert level_shares(ReturnModel(os1), 0.1, 45.0) == pytest.approx(0.9, abs=0.003)


@pytest.mark.parametrize("name", [n for n in sensor_names() if sensor(n).detection_range_80_m])
def test_both_targets_of_a_datasheet_return_nine_times_in_ten(ground_mesh, rig_of, name):
    one = rig_of(ground_mesh(), {"model": name}).sensors[0]
    # Units in the field see more than the datasheet promises, where that was measured.
    one = replace(one, sensor=replace(one.sensor, measured_light=None))
    ranges = {0.1: one.sensor.detection_range_10_m, 0.8: one.sensor.detection_range_80_m}
    for reflectivity, range_m in ranges.items():
        assert level_shares(ReturnModel(one), reflectivity, range_m) == pytest.approx(
            0.9, abs=0.003
        )


def test_half_return_at_1_2_times_that_range(os1):
    assert level_shares(ReturnModel(os1), 0.1, 45.0 / 0.69**0.5) == pytest.approx(0.5, abs=0.004)


@pytest.mark.parametrize("range_m", [5.0, 30.0, 50.0, 60.0, 80.0, 110.0])
@pytest.mark.parametrize("backscatter", [0.02, 0.1, 0.5])
def test_detection_follows_the_stated_formula(os1, range_m, backscatter):
    strength = strength_of(range_m, backscatter)
    steepness = np.log(9) / -np.log(0.69)
    expected = 1 / (1 + (0.69 / strength) ** steepness)
    sigma = np.sqrt(expected * (1 - expected) / 200_000)
    assert level_shares(ReturnModel(os1), backscatter, range_m) == pytest.approx(
        expected, abs=4 * sigma + 4e-5
    )


def test_half_of_the_faintest_surface_returns_however_near(os1):
    for range_m in (0.7, 1.5, 3.0):
        assert level_shares(ReturnModel(os1), FAINTEST, range_m) == pytest.approx(0.5, abs=0.01)
    assert level_shares(ReturnModel(os1), 3 * FAINTEST, 3.0) > 0.99


def test_the_faintest_surface_is_the_sensors(os1):
    """One dark pane: HDL-64E and VLP-16 lose most of it, a VLP-32C next to nothing."""
    seen, black = {}, {}
    for name in ("HDL-64E", "VLP-16", "VLP-32C"):
        one = ReturnModel(replace(os1, sensor=sensor(name)))
        assert level_shares(one, one.response.faintest, 2.0) == pytest.approx(0.5, abs=0.01)
        seen[name] = level_shares(one, 0.003, 5.0)
        black[name] = level_shares(one, 0.02, 5.0)
    assert seen["HDL-64E"] < 0.1
    assert seen["VLP-16"] < 0.1
    assert seen["VLP-32C"] > 0.99
    # Black paint that is faced squarely is seen by each: it bounds what panes may lose.
    assert min(black.values()) > 0.95


def test_units_with_measured_light_see_so_much_farther(os1):
    brighter = replace(os1, sensor=replace(os1.sensor, measured_light=4.0))
    assert level_shares(ReturnModel(brighter), 0.1, 90.0) == pytest.approx(
        level_shares(ReturnModel(os1), 0.1, 45.0), abs=0.06
    )


def test_actors_swallow_single_beams_as_the_table_says():
    """The share is the material's, and it is the same beams of the same triangles every time."""
    beam = np.arange(200_000, dtype=np.int32)
    face, facing = np.full_like(beam, 7), np.ones(len(beam), np.float32)
    some, none = (scatter_of_materials(905.0, swallows=one) for one in (True, False))
    for name, share in (("paint-white", 0.06), ("cloth", 0.02), ("asphalt", 0.0)):
        kind = np.full(len(beam), material_id(name), np.uint8)
        whole, through = none.of_actors(beam, face, kind, facing)
        np.testing.assert_array_equal(whole, none.backscatter(kind, facing))
        np.testing.assert_array_equal(through, none.transmission(kind, facing))
        left, _ = some.of_actors(beam, face, kind, facing)
        assert (left < 0.5 * whole).mean() == pytest.approx(share, abs=0.002)
        np.testing.assert_array_equal(left, some.of_actors(beam, face, kind, facing)[0])


def test_nothing_returns_outside_the_span_of_ranges(os1):
    low, high = os1.sensor.range_min_m, os1.sensor.range_max_m
    ranges = np.array([low * 0.99, low * 1.01, high * 0.999, high * 1.001, np.inf], np.float32)
    for effects in (Effects(), Effects(dropout=False)):
        model = ReturnModel(replace(os1, effects=effects))
        seen = model.detection(np.full(5, 0.9, np.float32), ranges) > 0.5
        assert seen.tolist() == [False, True, True, False, False]


def test_without_dropout_the_faintest_hit_returns(os1):
    model = ReturnModel(replace(os1, effects=Effects(dropout=False)))
    assert level_shares(model, 1e-6, 100.0) == 1.0
    assert level_shares(ReturnModel(os1), 1e-6, 100.0) == 0.0


@pytest.mark.parametrize(("snr", "sigma_cm"), [(12, 10.0), (100, 1.9), (250, 1.5), (5000, 1.5)])
def test_range_sigma_is_that_of_the_first_os1s_datasheet(ground_mesh, rig_of, snr, sigma_cm):
    """1.5 cm above an SNR of 250, 10 cm at 12; strength 1 is an SNR of 12."""
    mounted = rig_of(ground_mesh(), {}).sensors[0]
    old = replace(mounted.sensor, range_sigma_m=0.015, weak_sigma_m=None)
    model = ReturnModel(replace(mounted, sensor=old))
    n = 100_000
    range_m = 45.0 / np.sqrt(snr / 12)
    backscatter, ranges = np.full(n, 0.1, np.float32), np.full(n, range_m, np.float32)
    noise = model.sigma(backscatter, ranges) * standard_noise(draw(1, 0, 0, n).noise)
    assert noise.std() == pytest.approx(sigma_cm / 100, rel=0.05)
    assert abs(noise.mean()) < 4 * noise.std() / np.sqrt(n)


def test_ranges_of_the_datasheets_target_scatter_as_the_datasheet_says(os1):
    weak = ReturnModel(os1).sigma(np.full(1, 0.1, np.float32), np.full(1, 45.0, np.float32))
    assert weak[0] == pytest.approx(os1.sensor.weak_sigma_m, rel=0.01)


def test_sigma_never_falls_as_strength_falls(os1):
    ranges = np.linspace(1, 120, 500).astype(np.float32)
    sigma = ReturnModel(os1).sigma(np.full(500, 0.1, np.float32), ranges)
    assert (np.diff(sigma) >= 0).all()


def test_noise_is_standard_normal():
    noise = standard_noise(draw(3, 1, 4, 300_000).noise).astype(np.float64)
    assert kstest(noise, "norm").pvalue > 1e-3


@pytest.mark.parametrize(("low", "high"), [(-0.5, 0.2), (-3.0, 1.0), (0.0, 2.0), (-9.0, 9.0)])
def test_truncated_noise_is_scipys_truncated_normal(low, high):
    n = 200_000
    kept = truncated_noise(draw(3, 0, 9, n).noise, np.full(n, low), np.full(n, high))
    assert kept.min() >= low
    assert kept.max() <= high
    assert kstest(kept, truncnorm(low, high).cdf).pvalue > 1e-3


def test_truncation_leaves_what_lies_within():
    draws = draw(3, 0, 9, 10_000)
    plain = standard_noise(draws.noise)
    kept = truncated_noise(draws.noise, np.full(10_000, -1.0), np.full(10_000, 0.5))
    within = (plain > -0.999) & (plain < 0.499)
    np.testing.assert_allclose(kept[within], plain[within], atol=1e-6)


def test_ranges_are_whole_steps(os1):
    ranges = np.linspace(1, 119, 999).astype(np.float32)
    steps = ReturnModel(os1).quantised(ranges) / np.float32(os1.sensor.range_resolution_m)
    np.testing.assert_allclose(steps, np.rint(steps), atol=0.02)
    plain = ReturnModel(replace(os1, effects=Effects(quantisation=False)))
    np.testing.assert_array_equal(plain.quantised(ranges), ranges)
    quiet = ReturnModel(replace(os1, effects=Effects(noise=False)))
    assert (quiet.sigma(ranges, ranges) == 0).all()
    assert quiet.step_m > 0


def test_draws_differ_by_seed_sensor_and_frame_and_by_nothing_else():
    first = draw(1, 2, 3, 999)
    again = draw(1, 2, 3, 999)
    np.testing.assert_array_equal(first.detection, again.detection)
    np.testing.assert_array_equal(first.noise, again.noise)
    for other in (draw(2, 2, 3, 999), draw(1, 3, 3, 999), draw(1, 2, 4, 999)):
        assert (first.detection != other.detection).mean() > 0.99
    assert abs(np.corrcoef(first.detection, first.noise)[0, 1]) < 0.15


@pytest.mark.parametrize(
    ("model", "white", "greatest", "of_best"),
    [("OS1-128", 100, 255, 255), ("VLS-128", 110, 255, 255), ("Pandar64", 100, 255, 255)],
)
def test_intensity_is_the_sensors_own_code(ground_mesh, rig_of, model, white, greatest, of_best):
    """Percent of white below white, whatever the range; the brightest foil at the top.

    Nearby the receiver of an OS1 sees but a part: half at 7 m.
    """
    answers = ReturnModel(rig_of(ground_mesh(), {"model": model}).sensors[0])
    scatter = np.array([0, 0.1, 0.5, 1, 700 * np.pi, 1e6], np.float32)
    near = answers.intensity(scatter[3:4], np.full(1, 7.0, np.float32))[0] * greatest
    assert near == pytest.approx(white / 2 if model == "OS1-128" else white)
    for range_m in (30.0, 90.0):
        codes = answers.intensity(scatter, np.full(6, range_m, np.float32)) * greatest
        expected = [0, 0.1 * white, 0.5 * white, white, of_best, greatest]
        np.testing.assert_allclose(codes, expected, atol=0.5)
        np.testing.assert_allclose(codes, np.rint(codes), atol=1e-4)


def test_codes_of_an_os2_128_are_those_of_the_one_unit_that_is_known(ground_mesh, rig_of):
    """It told ground at 0.18 to 0.28 of full scale where a calibrated unit tells about 0.03."""
    mounted = rig_of(ground_mesh(), {"model": "OS2-128"}).sensors[0]
    calibrated = replace(mounted, sensor=replace(mounted.sensor, measured_code_scale=None))
    ground = np.full(1, 0.03 * 2.55, np.float32)
    far = np.full(1, 30.0, np.float32)
    assert ReturnModel(calibrated).intensity(ground, far)[0] == pytest.approx(0.03, abs=0.003)
    assert 0.18 < ReturnModel(mounted).intensity(ground, far)[0] < 0.28
    foils = np.pi * np.array([7, 70, 250, 700], np.float32)
    codes = 255 * ReturnModel(mounted).intensity(foils, far)
    assert (codes > 100).all()
    assert (np.diff(codes[:3]) > 0).all()
    assert codes[3] == 255
    # What is detected is a matter of light, not of the scale of codes.
    np.testing.assert_array_equal(
        ReturnModel(mounted).detection_level(ground, far),
        ReturnModel(calibrated).detection_level(ground, far),
    )


def test_foils_of_signs_have_codes_between_white_and_the_best(os1):
    """Class RA1 (70 cd/lx/m2) and RA2 (250): above 100, in order, below 255."""
    codes = 255 * ReturnModel(os1).intensity(np.pi * np.array([70, 250], np.float32))
    assert 150 < codes[0] < codes[1] < 250


def test_codes_are_not_rounded_without_quantisation(os1):
    scatter = np.linspace(0, 1, 99).astype(np.float32)
    plain = ReturnModel(replace(os1, effects=Effects(quantisation=False)))
    np.testing.assert_allclose(plain.intensity(scatter) * 255, scatter * 100, rtol=1e-5)
