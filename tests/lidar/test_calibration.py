"""What was found of one unit, and of materials, in closed form."""

import numpy as np
import pytest
from scipy.stats import binom

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.background import MeasuredBackground
from urbantwin.lidar.background_file import with_background
from urbantwin.lidar.placement import place_rig
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.scanner import Scanner
from urbantwin.lidar.sight import rig_coverage
from urbantwin.site.conditions import Conditions
from urbantwin.site.rig import RigSpec
from urbantwin.site.yaml_document import Document
from urbantwin.taxonomy import material_id

NIGHT = Conditions(sun_elevation_deg=-10.0)


@pytest.fixture
def one_of(ground_mesh, rig_of):
    """Return a maker of the model of a sensor: ``one_of(light=0.5)``."""

    def make(model="OS1-128", conditions=NIGHT, effects=True, rig=None, **calibration):
        mounted = {"model": model, "calibration": calibration, "effects": effects}
        placed = rig_of(ground_mesh(), mounted, **(rig or {}))
        return ReturnModel(placed.sensors[0], conditions)

    return make


@pytest.fixture
def frame_of(street, rig_of, crowd):
    """Return a maker of a frame of a VLP-16 in a street with actors."""
    standard = crowd(20, 3, 25.0)

    def make(frame=0, mesh=street, background=None, actors=standard, **sensor):
        rig = rig_of(mesh, {"model": "VLP-16", "height_m": 3.0} | sensor)
        if background is not None:
            rig = with_background(rig, background)
        return Scanner(mesh, rig, 7).scan(frame, actors)

    return make


def beams_of(frame):
    return frame.ring.astype(int) * 65536 + frame.column


def ranges_of(frame):
    """The frame of one levelled sensor lies in the sensor."""
    return np.linalg.norm(frame.points[:, :3].astype(float), axis=1)


@pytest.mark.parametrize("offset", [0.03, -0.25, 1.0])
def test_an_offset_comes_to_every_range(frame_of, offset):
    plain, moved = frame_of(), frame_of(calibration={"range_offset_m": offset})
    np.testing.assert_array_equal(beams_of(plain), beams_of(moved))
    np.testing.assert_array_equal(plain.instance, moved.instance)
    assert (plain.instance > 0).sum() > 50
    # Steps of a VLP-16's packets are 2 mm.
    np.testing.assert_allclose(ranges_of(moved) - ranges_of(plain), offset, atol=0.001 + 2e-5)


def test_an_offset_is_exact_without_steps(frame_of):
    plain = frame_of(effects=False)
    moved = frame_of(effects=False, calibration={"range_offset_m": 0.0313})
    np.testing.assert_allclose(ranges_of(moved) - ranges_of(plain), 0.0313, atol=2e-5)


def test_nothing_is_reported_behind_the_sensor(frame_of, box_mesh, ground_mesh):
    mesh = LabelledMesh.concatenate([ground_mesh(), box_mesh((0.7, -5, 0), (1.0, 5, 6))])
    plain, moved = (frame_of(mesh=mesh, calibration={"range_offset_m": m}) for m in (0.0, -1.0))
    assert ranges_of(plain).min() < 0.9
    along = (plain.points[:, :3] * moved.points[:, :3]).sum(axis=1)
    assert (along >= 0).all()


@pytest.mark.parametrize("factor", [0.0, 0.5, 3.0])
def test_sigma_scales(one_of, factor):
    amplitude, range_m = (np.array(v, np.float32) for v in ([0.1, 0.5, 0.02], [10, 50, 30]))
    plain = one_of().sigma(amplitude, range_m)
    np.testing.assert_allclose(
        one_of(range_noise=factor).sigma(amplitude, range_m), factor * plain, rtol=1e-6
    )


@pytest.mark.parametrize("p", [0.02, 0.3, 1.0])
def test_a_share_of_beams_is_missing(frame_of, p):
    """Whatever they meet: the same share of actors' points and of the ground's."""
    plain, fewer = frame_of(), frame_of(calibration={"missing": p})
    assert set(beams_of(fewer)) <= set(beams_of(plain))
    for chosen in (plain.instance > 0, plain.instance == 0):
        count = int(chosen.sum())
        lost = int((~np.isin(beams_of(plain)[chosen], beams_of(fewer))).sum())
        low, high = binom.ppf([1e-6, 1 - 1e-6], count, p)
        assert low <= lost <= high
    both = frame_of(1, calibration={"missing": p}), frame_of(1)
    if p < 1:  # Others in every frame.
        lost = [np.setdiff1d(beams_of(b), beams_of(a)) for a, b in ((fewer, plain), both)]
        assert len(np.intersect1d(*lost)) < 0.6 * len(lost[0])


def test_both_echoes_of_a_missing_beam_are_missing(frame_of):
    sensor = {"model": "VLP-32C", "returns": "dual"}
    plain, fewer = frame_of(**sensor), frame_of(**sensor, calibration={"missing": 0.4})
    number = np.unique(beams_of(plain), return_counts=True)
    kept = np.unique(beams_of(fewer), return_counts=True)
    assert number[1].max() == 2
    np.testing.assert_array_equal(number[1][np.isin(number[0], kept[0])], kept[1])


def test_without_effects_only_what_is_certain_remains(frame_of):
    plain = frame_of(effects=False)
    asked = {"range_noise": 5.0, "missing": 0.5, "light": 0.1}
    np.testing.assert_array_equal(frame_of(effects=False, calibration=asked).points, plain.points)


@pytest.mark.parametrize("light", [0.25, 0.8, 2.0])
def test_light_moves_the_range_at_which_half_returns(one_of, light):
    """With 1/range^2 and no sun: by the square root."""
    range_m = np.linspace(10, 190, 20001).astype(np.float32)
    amplitude = np.full(len(range_m), 0.1, np.float32)

    def half(model):
        return float(np.interp(0.5, model.detection(amplitude, range_m)[::-1], range_m[::-1]))

    # The exponent of a VLP-16, of which one range is known, is 2.
    plain, dirty = one_of("VLP-16"), one_of("VLP-16", light=light)
    assert half(dirty) / half(plain) == pytest.approx(np.sqrt(light), rel=2e-3)
    other = np.array([0.01, 0.3, 5.0], np.float32)
    away = np.array([5, 40, 90], np.float32)
    np.testing.assert_allclose(
        dirty.strength(other, away), light * plain.strength(other, away), rtol=1e-6
    )


def test_light_dims_the_air_too(one_of):
    """Seen through a dirty window a fog of which all is weak is seen less often."""
    fog = Conditions(weather="fog", visibility_m=60.0)
    seen = [one_of(conditions=fog, light=light).clutter.nearer[-1] for light in (0.3, 1.0)]
    assert 0 < seen[0] < seen[1] < 1


@pytest.mark.parametrize(("model", "dim", "bright"), [("VLP-16", 0.2, 40.0), ("OS1-128", 0.5, 9.0)])
def test_intensity_scales_to_the_greatest_code(one_of, model, dim, bright):
    effects = {"quantisation": False}
    amplitude = np.array([dim, bright, 1e6], np.float32)
    plain, other = (one_of(model, effects=effects, intensity=k) for k in (1.0, 1.2))
    expected = np.minimum(1.2 * plain.intensity(amplitude), 1.0)
    np.testing.assert_allclose(other.intensity(amplitude), expected, rtol=1e-6)
    far = np.full(3, 30, np.float32)
    np.testing.assert_array_equal(plain.strength(amplitude, far), other.strength(amplitude, far))


def test_reflectivity_doubles_the_strength_of_that_material_alone(one_of):
    plain, other = one_of(), one_of(rig={"reflectivity": {"asphalt": 2.0, "glass": 0.5}})
    ids = np.arange(len(plain.scatter.diffuse), dtype=np.uint8)
    cosine = np.full(len(ids), 0.3, np.float32)
    factor = np.ones(len(ids))
    factor[material_id("asphalt")], factor[material_id("glass")] = 2.0, 0.5
    range_m = np.full(len(ids), 20, np.float32)
    found, expected = (
        model.strength(model.scatter.backscatter(ids, cosine), range_m) for model in (other, plain)
    )
    np.testing.assert_allclose(found, factor * expected, rtol=1e-6)
    np.testing.assert_array_equal(
        other.scatter.transmission(ids, cosine), plain.scatter.transmission(ids, cosine)
    )


def test_a_measured_background_is_this_units_already(frame_of):
    """What it says of ranges, noise and drop-out holds whatever else is known of the unit."""
    shape = (1, 16, 1800)
    rng = np.random.default_rng(1)
    background = MeasuredBackground(
        rng.integers(1000, 20000, shape).astype(np.float32) * np.float32(0.002),
        np.full(shape, 0.02, np.float32),
        np.full(shape, 0.9, np.float32),
        np.full(shape, 0.3, np.float32),
    )
    calibration = {"range_offset_m": 0.5, "range_noise": 4.0, "intensity": 2.0, "missing": 0.05}
    plain = frame_of(background=background, actors=())
    found = frame_of(background=background, actors=(), calibration=calibration)
    for frame in (plain, found):
        away = ranges_of(frame) - background.range_m[0, frame.ring, frame.column]
        assert np.std(away) == pytest.approx(0.02, rel=0.05)
        assert abs(np.mean(away)) < 0.001
        assert np.median(frame.points[:, 3]) == pytest.approx(0.3, abs=1e-6)
    assert len(found.points) == pytest.approx(len(plain.points), rel=0.01)


@pytest.mark.parametrize(
    ("changes", "place", "expected"),
    [
        ({"reflectivity": {"asfalt": 0.8}}, "reflectivity", "'asphalt'"),
        ({"reflectivity": {"asphalt": 0.0}}, "reflectivity.asphalt", "0.01"),
        ({"calibration": {"light": 11.0}}, "sensors[0].calibration.light", "10"),
        ({"calibration": {"missing": -0.1}}, "sensors[0].calibration.missing", "0"),
        ({"calibration": {"noise": 1.0}}, "sensors[0].calibration.noise", "range_noise"),
        ({"calibration": {"range_offset_m": float("nan")}}, "range_offset_m", "finite"),
    ],
)
def test_what_is_refused(tmp_path, changes, place, expected):
    sensor = {"name": "a", "model": "VLP-16", "east_m": 0.0, "north_m": 0.0, "height_m": 3.0}
    sensor |= {key: value for key, value in changes.items() if key == "calibration"}
    rig = {key: value for key, value in changes.items() if key == "reflectivity"}
    with pytest.raises(InputError) as error:
        Document(tmp_path / "rig.yaml", rig | {"sensors": [sensor]}).validated(RigSpec)
    assert place in str(error.value)
    assert expected in str(error.value)


def test_coverage_counts_what_is_missing(street, rig_of):
    sensor = {"model": "VLP-16"}
    area = (-20.0, -20.0, 20.0, 20.0)
    density = [
        rig_coverage(rig_of(street, sensor | {"calibration": one}), street, area, cell_m=2.0)
        for one in ({}, {"missing": 0.25})
    ]
    np.testing.assert_allclose(density[1].ground, 0.75 * density[0].ground, rtol=1e-5)


def test_the_rigs_file_comes_back_as_it_was_written(ground_mesh):
    sensor = {"name": "a", "model": "VLP-16", "east_m": 0.0, "north_m": 0.0, "height_m": 3.0}
    sensor["calibration"] = {"light": 0.8}
    spec = RigSpec.model_validate({"sensors": [sensor], "reflectivity": {"asphalt": 0.8}})
    assert RigSpec.model_validate(spec.written()) == spec
    placed = place_rig(spec, ground_mesh())
    assert placed.sensors[0].calibration.light == 0.8
