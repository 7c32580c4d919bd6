"""Weather against closed forms: extinction, sizes of drops, and how often the air is detected."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from urbantwin.lidar.returns import Purpose, ReturnModel, draw
from urbantwin.lidar.returns.clutter import (
    CELL_M,
    FOG_RATIO_SR,
    beam_area,
    collected,
    extinction,
    haze_exponent,
    rain,
    snow,
    snow_rate_mm_h,
)
from urbantwin.site.rig import Conditions, Effects

BEAMS = 200_000


@pytest.fixture(scope="module")
def os1(ground_mesh, rig_of):
    return rig_of(ground_mesh(), {}).sensors[0]


def in_weather(mounted, kind, visibility_m, **effects):
    conditions = Conditions(weather=kind, visibility_m=visibility_m)
    return ReturnModel(replace(mounted, effects=Effects(**effects)), conditions)


@pytest.mark.parametrize("weather", ["fog", "rain", "snow"])
@pytest.mark.parametrize("visibility_m", [50.0, 300.0, 2000.0])
def test_a_beam_falls_to_a_twentieth_at_the_visibility(os1, weather, visibility_m):
    """Koschmieder's law, one way; what comes back went both ways."""
    foggy = in_weather(os1, weather, visibility_m)
    clear = ReturnModel(os1)
    amplitude, range_m = np.full(3, 0.3, "f4"), np.array([0.1, 0.5, 1.0], "f4") * visibility_m
    expected = 0.05 ** (2 * range_m / visibility_m)
    ratio = foggy.strength(amplitude, range_m) / clear.strength(amplitude, range_m)
    np.testing.assert_allclose(ratio, expected, rtol=1e-4)


def test_intensity_dims_with_the_air(os1):
    foggy = in_weather(os1, "fog", 100.0, quantisation=False)
    clear = ReturnModel(replace(os1, effects=Effects(quantisation=False)))
    white, there = np.ones(1, "f4"), np.full(1, 20, "f4")
    left = foggy.intensity(white, there)[0] / clear.intensity(white, there)[0]
    assert left == pytest.approx(0.05**0.4, rel=1e-4)


def test_haze_weakens_long_wavelengths_less_and_fog_all_alike():
    """Kim's exponent at its corners, and the ratio of 1550 to 905 nm."""
    assert [haze_exponent(v) for v in (100, 500, 1000, 6000, 20_000, 60_000)] == pytest.approx(
        [0, 0, 0.5, 1.3, 1.3, 1.6]
    )
    for visibility_m, q in ((1000.0, 0.5), (3000.0, 0.16 * 3 + 0.34), (10_000.0, 1.3)):
        haze = Conditions(visibility_m=visibility_m)
        ratio = extinction(haze, 1550) / extinction(haze, 905)
        assert ratio == pytest.approx((1550 / 905) ** -q, rel=1e-6)
    fog = Conditions(weather="fog", visibility_m=1000.0)
    assert extinction(fog, 1550) == extinction(fog, 905)


def test_clear_air_of_no_visibility_takes_nothing():
    assert extinction(Conditions(), 905) == 0


@pytest.mark.parametrize("rate", [1.0, 10.0, 50.0])
def test_rain_of_a_rate_has_marshall_and_palmers_drops(rate):
    """From the rate to the extinction by summing drops in mm, and back."""
    slope = 4.1 * rate**-0.21
    area, _ = quad(lambda d: 2 * np.pi / 4 * d * d * 8000 * np.exp(-slope * d), 0, 40)
    beta = area * 1e-6
    drops = rain(beta)
    assert drops.slope == pytest.approx(slope * 1e3, rel=1e-6)
    assert drops.extinction == pytest.approx(beta, rel=1e-6)
    # Water's spheres: 2 % of the light at the front, focused at the rear.
    front = ((1.33 - 1) / (1.33 + 1)) ** 2
    rear = front * (1 - front) ** 2 * (1.33 / 0.67) ** 2
    assert drops.white == pytest.approx((front + rear) / 4, rel=1e-9)


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_snow_of_a_rate_has_gunn_and_marshalls_flakes(rate):
    slope, n0, width = 2.55 * rate**-0.48, 3800 * rate**-0.87, 10 ** (1 / 3)
    area, _ = quad(lambda d: 2 * np.pi / 4 * (width * d) ** 2 * n0 * np.exp(-slope * d), 0, 60)
    beta = area * 1e-6
    assert snow_rate_mm_h(beta) == pytest.approx(rate, rel=1e-6)
    assert snow(beta, 905).extinction == pytest.approx(beta, rel=1e-6)
    assert snow(beta, 1550).white < 0.1 * snow(beta, 905).white


@pytest.mark.parametrize(("weather", "visibility_m"), [("snow", 1000.0), ("rain", 200.0)])
def test_flakes_and_drops_are_detected_as_often_as_poisson_says(os1, weather, visibility_m):
    """The chance of none by integrating over distance and size, worked out apart."""
    model = in_weather(os1, weather, visibility_m)
    beta = -np.log(0.05) / visibility_m
    particles = rain(beta) if weather == "rain" else snow(beta, 865)
    sensor, end = os1.sensor, 12.0
    ranges = np.linspace(sensor.range_min_m, end, 400)
    sizes = np.linspace(1e-6, 25 / particles.slope, 3000)
    spread = np.pi / 4 * (0.0095 + np.radians(0.18) * ranges) ** 2
    fill = np.minimum(np.pi / 4 * sizes**2 / spread[:, None], 1)
    near = ranges**2 / (ranges**2 + 0.01 * 10 * 45**2)
    amplitude = (particles.white * fill * near[:, None]).astype("f4")
    where = np.broadcast_to(ranges[:, None], fill.shape).astype("f4").ravel()
    # The model's own strength is tested elsewhere; outside of its span nothing is detected.
    strength = model.strength(amplitude.ravel(), where).reshape(fill.shape).astype(float)
    seen = 1 / (1 + (0.69 / np.maximum(strength, 1e-9)) ** (np.log(9) / -np.log(0.69)))
    number = particles.n0 * np.exp(-particles.slope * sizes)
    rate = spread * np.trapezoid(number * seen, sizes, axis=1)
    expected = 1 - np.exp(-np.trapezoid(rate, ranges))
    limit = np.full(BEAMS, end, "f4")
    beam, range_m, bright = model.clutter.draw(draw(1, 0, 0, BEAMS, Purpose.CLUTTER), limit)
    assert len(beam) > 50
    noise = np.sqrt(expected / BEAMS)
    assert len(beam) / BEAMS == pytest.approx(expected, rel=0.02, abs=4 * noise)
    assert range_m.min() >= sensor.range_min_m
    assert range_m.max() < end
    assert (bright > 0).all()
    assert (bright <= particles.white).all()


def test_fog_of_one_pulse_length_is_detected_by_the_sensors_own_probability(os1):
    """Of a sensor that looks no farther than a pulse is long, in closed form."""
    sensor = replace(os1.sensor, range_min_m=3.0, range_max_m=3.5)
    model = in_weather(replace(os1, sensor=sensor), "fog", 40.0)
    beta, middle = -np.log(0.05) / 40, 3.0 + CELL_M / 2
    amplitude = np.pi * beta / FOG_RATIO_SR * CELL_M
    amplitude *= middle**2 / (middle**2 + 0.01 * 10 * 45**2)
    there = np.array([amplitude], "f4")
    strength = model.strength(there, np.array([middle], "f4"))[0]
    expected = 1 / (1 + (0.69 / strength) ** (np.log(9) / -np.log(0.69)))
    assert 0.05 < expected < 0.95
    found, _, _ = model.clutter.draw(draw(1, 0, 0, BEAMS), np.full(BEAMS, np.inf, "f4"))
    assert len(found) / BEAMS == pytest.approx(expected, abs=0.004)


def test_clutter_lies_before_what_a_beam_meets_and_grows_with_the_fog(os1):
    draws = draw(4, 0, 2, BEAMS, Purpose.CLUTTER)
    limit = np.random.default_rng(1).uniform(1, 30, BEAMS).astype("f4")
    counts = []
    for visibility_m in (400.0, 100.0, 60.0, 30.0):
        beam, range_m, _ = in_weather(os1, "fog", visibility_m).clutter.draw(draws, limit)
        assert (range_m < limit[beam]).all()
        counts.append(len(beam))
    assert counts == sorted(counts)
    assert counts[0] < 0.01 * BEAMS
    assert counts[-1] > 0.5 * BEAMS


def test_clear_air_and_weather_turned_off_are_the_same(os1):
    off = in_weather(os1, "fog", 50.0, weather=False)
    assert off.clutter is None
    amplitude, range_m = np.full(5, 0.2, "f4"), np.linspace(1, 80, 5, dtype="f4")
    for ours, clear in zip(
        off.answers(amplitude, range_m), ReturnModel(os1).answers(amplitude, range_m), strict=True
    ):
        np.testing.assert_array_equal(ours, clear)
    np.testing.assert_array_equal(off.scatter.curve, ReturnModel(os1).scatter.curve)


def test_beams_widen_by_their_divergence(os1):
    far = beam_area(os1.sensor, np.array([0.0, 100.0]))
    np.testing.assert_allclose(
        far, np.pi / 4 * np.array([0.0095, 0.0095 + 100 * np.radians(0.18)]) ** 2
    )


def test_what_is_near_is_collected_as_white_of_a_hundredth(os1):
    """Right before the sensor an amplitude of 1 % has strength 1, as the docstring says."""
    response = ReturnModel(os1).response._replace(sun_noise=0.0, floor=1.0)
    near = 1e-3
    share = collected(response, np.array([near]))[0]
    assert response.per_amplitude * 0.01 * share / near**2 == pytest.approx(1, rel=1e-6)
