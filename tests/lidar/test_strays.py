"""Blooming and crosstalk against what the stated skirt gives, and where added echoes go."""

from functools import partial

import numpy as np
import pytest

from urbantwin.lidar.beams import Beams
from urbantwin.lidar.compiled.return_mode import MODES, settle
from urbantwin.lidar.detections import Detections, Slots
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.returns.strays import (
    ISOLATION,
    SKIRT,
    Source,
    Stray,
    blooms,
    crosstalks,
    spilled,
    strongest_of,
)
from urbantwin.taxonomy import materials

COLUMNS = 1024


@pytest.fixture(scope="module")
def os1(ground_mesh, rig_of):
    return rig_of(ground_mesh(), {}).sensors[0]


def halo_of(model, sensor, beams, *sources):
    spills = [(spilled(model, sensor, beams, beams.rings, source), source) for source in sources]
    return blooms(spills)


def one(beam, range_m, amplitude):
    return Source(
        np.array([beam], np.int32), np.array([range_m], "f4"), np.array([amplitude], "f4")
    )


@pytest.mark.parametrize("model_name", ["OS1-128", "VLP-32C", "Pandar64"])
@pytest.mark.parametrize("column", [0, 511, 1023])
def test_a_sign_blooms_into_all_beams_around_it_that_the_skirt_reaches(
    ground_mesh, rig_of, model_name, column
):
    """Every beam of the sensor looked at, in float64."""
    mounted = rig_of(ground_mesh(), {"model": model_name}).sensors[0]
    model, columns = ReturnModel(mounted), mounted.columns
    beams = Beams.of(mounted)
    sign = 40 % mounted.sensor.channels * columns + column
    amplitude, range_m = 2000.0, 15.0
    halo = halo_of(
        model,
        mounted.sensor,
        beams,
        one(sign, range_m, amplitude),
    )
    # Of both ways: the OS1's, or what is assumed of those that publish none.
    width = np.radians(np.sqrt(np.prod(mounted.sensor.beam_divergence_deg or (0.18, 0.09))))
    angle = 2 * np.arcsin(np.linalg.norm(beams.directions - beams.directions[sign], axis=1) / 2)
    angle[sign] = np.inf
    expected = amplitude * SKIRT * np.minimum(1, (width / angle) ** 3)
    # What every echo of the skirt would be as strong as, in the dark.
    dark = np.zeros(len(beams.directions), "f4")
    strength = model.strength(expected.astype("f4"), np.full(len(expected), range_m, "f4"), dark)
    wanted, clear = strength > 0.02, np.abs(strength - 0.02) > 1e-4
    got = np.zeros(len(expected), bool)
    got[halo.beam] = True
    assert len(np.unique(halo.beam)) == len(halo.beam)
    assert wanted.sum() > 10
    np.testing.assert_array_equal(got[clear], wanted[clear])
    np.testing.assert_allclose(halo.amplitude, expected[halo.beam], rtol=1e-4)
    np.testing.assert_allclose(halo.range_m, range_m, rtol=1e-6)


def test_light_of_several_bright_beams_adds_up_where_it_arrives_together(os1):
    model, beams = ReturnModel(os1), Beams.of(os1)
    near, also, far = one(5000, 10.0, 900.0), one(5001, 10.4, 900.0), one(5002, 20.0, 900.0)
    alone = [halo_of(model, os1.sensor, beams, source) for source in (near, also, far)]
    every = Source(*(np.concatenate(parts) for parts in zip(near, also, far, strict=True)))
    halo = halo_of(model, os1.sensor, beams, every)
    for beam in (4999, 5003):
        light = [part.amplitude[part.beam == beam][0] for part in alone]
        got = halo.beam == beam
        np.testing.assert_allclose(halo.amplitude[got], [light[0] + light[1], light[2]], rtol=1e-5)
        mean = (light[0] * 10 + light[1] * 10.4) / (light[0] + light[1])
        np.testing.assert_allclose(halo.range_m[got], [mean, 20], rtol=1e-5)


def test_a_dim_or_far_sign_does_not_bloom(os1):
    beams = Beams.of(os1)
    for amplitude, range_m in ((1.5, 20.0), (220.0, 119.9)):
        halo = halo_of(ReturnModel(os1), os1.sensor, beams, one(5000, range_m, amplitude))
        assert ReturnModel(os1).noticed_level(halo.amplitude, halo.range_m).max(initial=0) == 0


def test_crosstalk_stands_in_channels_that_fire_together(os1):
    sheeting = materials()["retroreflector"].retro
    times = np.array([0, 0, 1, 1, 0, 2]) * 1e-6
    found = crosstalks(ReturnModel(os1), times, 100, one(417, 8.0, sheeting))
    assert sorted(found.beam) == [17, 117]
    np.testing.assert_allclose(found.amplitude, sheeting * ISOLATION, rtol=1e-5)
    assert (found.range_m == 8).all()
    assert len(crosstalks(ReturnModel(os1), times, 100, one(217, 110.0, 50.0)).beam) == 0


def test_the_strongest_of_several_added_echoes_stays():
    first = Stray(np.array([7, 3], "i4"), np.array([1, 2], "f4"), np.array([0.1, 0.2], "f4"))
    second = Stray(np.array([3], "i4"), np.array([5], "f4"), np.array([0.3], "f4"))
    kept, strength = strongest_of([first, second], [np.array([1, 2], "f4"), np.array([4], "f4")])
    assert kept.beam.tolist() == [3, 7]
    assert kept.range_m.tolist() == [5, 1]
    assert strength.tolist() == [4, 1]


def by_hand(beam, range_m, strength, added, added_strength, returns):
    """Beam by beam, as the docstring says: (beam, range, echo)."""
    rows = {}
    for b, r, s in zip(beam, range_m, strength, strict=True):
        rows.setdefault(int(b), []).append((float(r), float(s)))
    for b, r, s in zip(added.beam, added.range_m, added_strength, strict=True):
        have = rows.setdefault(int(b), [])
        mine = (float(r), float(s))
        if not have:
            have.append(mine)
        elif returns == "dual" and len(have) == 1:
            have.insert(0 if s > have[0][1] else 1, mine)
        elif returns == "last":
            have[0] = mine if r > have[0][0] else have[0]
        elif returns == "first":
            have[0] = mine if r < have[0][0] else have[0]
        elif s > have[0][1]:
            have[0] = mine
    return [(b, r, n) for b in sorted(rows) for n, (r, _) in enumerate(rows[b])]


@pytest.mark.parametrize("returns", MODES)
@pytest.mark.parametrize("count", [0, 300])
def test_added_echoes_take_their_place_among_the_reported(returns, count):
    rng = np.random.default_rng(5)
    most = 2 if returns == "dual" else 1
    beam = np.sort(np.repeat(rng.choice(1000, 400, replace=False), rng.integers(1, most + 1, 400)))
    beam = beam[:count].astype("i4")
    range_m, strength = rng.uniform(1, 50, (2, count)).astype("f4")
    named = np.sort(rng.choice(1000, 350, replace=False)).astype("i4")
    far, strong = rng.uniform(1, 50, (2, 350)).astype("f4")
    added = Stray(named, far, strong)
    low, high = (np.searchsorted(beam, named, side) for side in ("left", "right"))
    # Rows are left out where a beam reports fewer than the sensor does.
    free = high - low < most
    kept = partial(np.insert, obj=high[free])
    echo = (np.diff(beam, prepend=-1) == 0).astype("u1")
    whole = kept(np.zeros(count, "i4"), values=0)
    ranges = kept(range_m, values=0)
    reported = Detections(
        kept(beam, values=named[free]), kept(echo, values=9), whole.astype("u2"), ranges, ranges,
        whole,
    )  # fmt: skip
    slots = Slots(named, (low + np.cumsum(free) - free).astype("i4"), (high - low).astype("u1"))
    first = np.append(strength, 0).astype("f4")[low]
    settle(reported, slots, far, strong, far, far, first, MODES.index(returns))
    rows = [one.tolist() for one in (reported.beam, reported.range_m, reported.echo)]
    rows = list(zip(*rows, strict=True))
    assert rows == by_hand(beam, range_m, strength, added, strong, returns)
