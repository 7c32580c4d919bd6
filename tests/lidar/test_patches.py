"""Ground that is not as bright everywhere, and pulses that grazed ground stretches."""

import numpy as np
import pytest
from scipy.stats import kstest, norm

from urbantwin.lidar.catalogue import sensor
from urbantwin.lidar.returns import ReturnModel, scatter_of_materials
from urbantwin.lidar.returns.model import peak_left
from urbantwin.lidar.returns.scatter import PATCHES, TEXTURE
from urbantwin.lidar.scanner import Scanner

from ..thorough import further

SCATTER = scatter_of_materials(865.0, texture=True)
SIGMA = np.sqrt(sum(sigma**2 for _, sigma in PATCHES))


def logarithms(east, north):
    return np.log(SCATTER.patches(np.column_stack([east, north, 0 * east])).astype(float))


def test_patches_are_log_normal_about_the_tables_value():
    rng = np.random.default_rng(1)
    found = logarithms(*rng.uniform(-4e4, 4e4, (2, 50_000)))
    assert kstest(found, norm(0, SIGMA).cdf).pvalue > 1e-3
    assert pytest.approx(np.hypot(SIGMA, TEXTURE)) == SCATTER.ground_spread


def test_places_differ_the_more_the_farther_they_are_apart():
    """As the variogram of real roads: not at all side by side, wholly at tens of metres."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-3e4, 3e4, (2, 60_000))
    turn = rng.uniform(0, 2 * np.pi, len(x))
    here, gamma = logarithms(x, y), []
    for lag in (0.001, 0.1, 0.5, 1.5, 3.0, 9.0, 40.0):
        there = logarithms(x + lag * np.cos(turn), y + lag * np.sin(turn))
        gamma.append(np.mean((here - there) ** 2) / 2 / SIGMA**2)
    assert (np.diff(gamma) > 0).all()
    assert gamma[0] < 1e-4
    assert gamma[2] == pytest.approx(0.2, abs=0.07)
    assert gamma[-1] == pytest.approx(1, abs=0.03)


def test_a_place_is_as_bright_whoever_asks_and_however():
    x, y = np.random.default_rng(3).uniform(-50, 50, (2, 1000))
    whole = logarithms(x, y)
    np.testing.assert_array_equal(logarithms(x[::-1], y[::-1]), whole[::-1])
    np.testing.assert_array_equal(logarithms(x[500:501], y[500:501]), whole[500:501])
    away = scatter_of_materials(865.0).patches(np.column_stack([x, y, 0 * x]))
    assert (away == 1).all()


@pytest.mark.parametrize(("cosine", "share"), [(1.0, 0.0008), (0.1, 0.008), (0.01, 0.03)])
def test_ground_throws_on_what_comes_in_flat(cosine, share):
    """As often as the law says, in places: who looks there twice is lost twice."""
    scatter = scatter_of_materials(865.0, swallows=True)
    places = np.random.default_rng(6).uniform(-3e4, 3e4, (200_000, 3))
    lost = scatter.thrown_on(places, np.full(len(places), cosine, np.float32)) < 0.5
    assert lost.mean() == pytest.approx(share, rel=0.25)
    near = scatter.thrown_on(places[lost] + [0.02, 0.0, 0.0], np.full(lost.sum(), cosine, "f4"))
    assert (near < 0.5).mean() > 0.7
    kept = scatter_of_materials(865.0).thrown_on(places[lost], np.full(lost.sum(), cosine, "f4"))
    assert (kept == 1).all()


def test_two_sensors_see_the_same_patches(ground_mesh, rig_of):
    """Where one reports bright ground the other does too."""
    effects = {"effects": {"footprint": False, "quantisation": False}}
    images = []
    for place in (0.0, 2.0):
        rig = rig_of(ground_mesh(), {"east_m": place, "height_m": 5.0, **effects}, frame="site")
        frame = Scanner(ground_mesh(), rig, 1).scan(0, [])
        near = np.abs(frame.points[:, :2]).max(axis=1) < 25
        x, y, _, light = frame.points[near].astype(float).T
        cells = (np.floor((x + 25) / 0.5) * 100 + np.floor((y + 25) / 0.5)).astype(int)
        total = np.bincount(cells, np.log(light * 255), 10_000)
        count = np.bincount(cells, minlength=10_000)
        images.append(np.where(count > 2, total / np.maximum(count, 1), np.nan))
    both = np.isfinite(images).all(axis=0)
    assert both.sum() > 1000
    assert np.corrcoef(images[0][both], images[1][both])[0, 1] > 0.6


@pytest.mark.parametrize(
    ("range_m", "grazing_deg"), [(20.0, 6.0), *further((10.0, 40.0), (30.0, 4.0), (60.0, 2.0))]
)
def test_a_matched_filter_sees_that_much_of_a_stretched_pulse(range_m, grazing_deg):
    """Pulse, footprint on the ground and filter convolved by numbers."""
    width = np.radians(0.18)
    step = 0.01
    at = np.arange(-25, 25, step)

    def bell(fwhm):
        one = np.exp(-4 * np.log(2) * (at / fwhm) ** 2)
        return one / one.sum()

    angle = np.radians(90 - grazing_deg)
    pulse = bell(0.75)
    received = np.convolve(pulse, bell(max(range_m * width * np.tan(angle), step)), "same")
    peaks = [np.convolve(one, pulse[::-1], "same").max() for one in (received, pulse)]
    found = peak_left(width, np.array([range_m]), np.array([np.cos(angle)]))[0]
    assert found == pytest.approx(peaks[0] / peaks[1], rel=2e-3)


def test_stretching_weakens_and_does_not_darken(ground_mesh, rig_of):
    model = ReturnModel(rig_of(ground_mesh(), {}).sensors[0])
    amplitude, range_m = np.array([0.05], np.float32), np.array([25.0], np.float32)
    whole = model.answers(amplitude, range_m)
    half = model.answers(amplitude, range_m, peak=np.array([0.5], np.float32))
    strength = model.strength(amplitude, range_m)[0]
    assert half[2] == whole[2]
    expected = 1 / (1 + (0.69 / (strength / 2)) ** model.response.steepness)
    assert half[0][0] / 65536 == pytest.approx(expected, abs=1e-4)
    assert half[1][0] > whole[1][0]


@pytest.mark.parametrize(
    ("given", "wide"),
    [({"model": "OS1-128"}, True), ({"effects": {"footprint": False}}, False),
     ({"model": "VLP-16"}, False)],
)  # fmt: skip
def test_thin_beams_are_not_stretched(ground_mesh, rig_of, given, wide):
    model = ReturnModel(rig_of(ground_mesh(), given).sensors[0])
    left = model.peak_left(np.array([40.0], "f4"), np.array([0.05], "f4"))[0]
    assert (left < 0.5) if wide else (left == 1)


def test_frames_lose_the_road_as_the_law_says(ground_mesh, rig_of):
    """Share of beams that return from level asphalt, against the law averaged over brightness."""
    rig = rig_of(ground_mesh(200.0), {"height_m": 2.0, "columns": 512})
    frame = Scanner(ground_mesh(200.0), rig, 5).scan(0, [])
    one = rig.sensors[0]
    model = ReturnModel(one)
    up = np.sin(np.radians(np.asarray(sensor("OS1-128").elevation_deg)))
    checked = 0
    for ring in np.flatnonzero(up < -0.03):
        range_m = np.array([2.0 / -up[ring]], np.float32)
        if not 12 < range_m[0] < 50:
            continue
        cosine = np.array([-up[ring]], np.float32)
        material = np.array([1], np.uint8)
        amplitude = model.scatter.backscatter(material, cosine) * np.exp(-(TEXTURE**2) / 2)
        peak = model.peak_left(range_m, cosine)
        chance = model.detection_among(amplitude, range_m, model.scatter.ground_spread, peak)[0]
        share = (frame.ring == ring).sum() / 512
        # Patches make beams of a ring alike: there are fewer of them than beams.
        assert share == pytest.approx(chance, abs=0.11)
        checked += 1
    assert checked > 10
