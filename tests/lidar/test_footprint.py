"""The rays of a beam against the Gaussian beam that they stand for, and what edges do to points."""

import numpy as np

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner, sensor
from urbantwin.lidar.beams import Footprint
from urbantwin.taxonomy import semantic_id

THIN = dict.fromkeys(("noise", "dropout", "quantisation", "sun", "blooming"), False)


def test_the_rays_spread_light_as_a_gaussian_beam_does():
    model = sensor("VLS-128")
    beam = Footprint.of(model)
    rng = np.random.default_rng(0)
    # Half maximum is where the light has fallen to a half: exp(-r^2 / (2 s^2)) = 1/2.
    s = np.radians(model.beam_divergence_deg) / 2 / np.sqrt(2 * np.log(2))
    light = rng.normal(0.0, s, (2_000_000, 2))
    assert np.isclose(beam.share.sum(), 1.0)
    np.testing.assert_allclose(beam.share @ beam.offset, 0.0, atol=1e-12)
    np.testing.assert_allclose(beam.share @ beam.offset**2, (light**2).mean(axis=0), rtol=0.01)
    assert abs(beam.share @ beam.offset.prod(axis=1)) < 1e-12


def test_a_beam_of_unknown_width_is_as_wide_as_that_of_the_vls_128():
    assert sensor("HDL-32E").beam_divergence_deg is None
    np.testing.assert_array_equal(
        Footprint.of(sensor("HDL-32E")).offset, Footprint.of(sensor("VLS-128")).offset
    )


def walls(box_mesh, gap):
    """A wall at 20 m that ends at y = 0, and a wall ``gap`` behind it that goes on."""
    front = box_mesh((20, 0, -10), (20.01, 30, 10), part=1)
    back = box_mesh((20 + gap, -30, -10), (20.01 + gap, 30, 10), part=2)
    return LabelledMesh.concatenate([front, back])


def points_at_the_edge(box_mesh, rig_of, ground_mesh, gap, **sensor_fields):
    far = ground_mesh(half=200.0, z=-60.0)
    place = {"model": "OS1-128", "height_m": 60.0, "effects": THIN, **sensor_fields}
    rig = rig_of(far, place, frame="sensor")
    frame = Scanner(walls(box_mesh, gap), rig, 0).scan(0, [])
    level = np.abs(frame.points[:, 2]) < 0.15 * frame.points[:, 0]
    return frame, level & (np.abs(frame.points[:, 1]) < 0.01 * frame.points[:, 0])


def test_surfaces_close_to_each_other_give_mixed_ranges(box_mesh, rig_of, ground_mesh):
    """Nearer than a pulse is long, what a beam at the edge reports lies between the walls."""
    frame, edge = points_at_the_edge(box_mesh, rig_of, ground_mesh, 0.5)
    x = frame.points[edge, 0]
    between = (x > 20.05) & (x < 20.45)
    assert 5 < between.sum() < 0.5 * len(x)


def test_surfaces_far_from_each_other_give_two_echoes(box_mesh, rig_of, ground_mesh):
    frame, edge = points_at_the_edge(
        box_mesh, rig_of, ground_mesh, 3.0, model="VLS-128", returns="dual"
    )
    x, echo = frame.points[edge, 0], frame.echo[edge]
    assert not ((x > 20.05) & (x < 22.95)).any()
    beam = frame.ring[edge].astype(int) * 10_000 + frame.column[edge]
    both = np.isin(beam, beam[echo == 1])
    assert both.sum() > 10
    for one in np.unique(beam[both]):
        np.testing.assert_allclose(sorted(x[beam == one]), [20, 23], atol=0.1)
    # The near part is as bright, or less; the strongest comes first, by strength at the sensor.
    for mode, nearest in (("last", False), ("strongest", None)):
        again, edge_2 = points_at_the_edge(
            box_mesh, rig_of, ground_mesh, 3.0, model="VLS-128", returns=mode
        )
        assert (again.echo == 0).all()
        split = np.isin(again.ring.astype(int) * 10_000 + again.column, beam[both]) & edge_2
        far = again.points[split, 0] > 22
        assert far.all() if nearest is False else 0 < far.mean() < 1


def test_without_the_effect_there_is_no_such_point(box_mesh, rig_of, ground_mesh):
    thin = {**THIN, "footprint": False}
    frame, edge = points_at_the_edge(box_mesh, rig_of, ground_mesh, 0.5, effects=thin)
    x = frame.points[edge, 0]
    assert not ((x > 20.05) & (x < 20.45)).any()


def test_a_wire_thinner_than_the_beams_are_apart_is_seen(box_mesh, rig_of, ground_mesh):
    """A pole of 2 cm at 20 m stands between the axes of beams, and in the beams."""
    far = ground_mesh(half=200.0, z=-60.0)
    azimuth = 2 * np.pi * 100.25 / 1024
    middle = 20 * np.array([np.cos(azimuth), np.sin(azimuth)])
    low, high = (*(middle - 0.01), -10), (*(middle + 0.01), 10)
    pole = box_mesh(low, high, "pole", "metal-painted")
    counts = []
    for effects in ({**THIN, "footprint": False}, THIN):
        place = {"model": "OS1-128", "columns": 1024, "height_m": 60.0, "effects": effects}
        frame = Scanner(pole, rig_of(far, place, frame="sensor"), 0).scan(0, [])
        counts.append(int((frame.semantic == semantic_id("pole")).sum()))
    assert counts[0] < 40 < counts[1]
