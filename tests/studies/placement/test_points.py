"""What views see, against whole recordings of the layouts that they make."""

import numpy as np
import pytest

from urbantwin.dataset.frame_motion import FrameMotions
from urbantwin.dataset.motion_interpolation import posed_actors
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner, place_rig
from urbantwin.studies.placement.beam_voxels import occupied_voxels, passed_voxels
from urbantwin.studies.placement.judge import hidden_actors
from urbantwin.studies.placement.sighting import read_sighting
from urbantwin.taxonomy import semantic_classes


def recorded(question, layout, seeds):
    """Return the points on each target of whole recordings of a layout's rig, (seeds, P)."""
    twin, motion = question.twin, question.motion
    rig = place_rig(question.views.rig_spec(layout, twin.reflectivity), twin.mesh)
    motions = FrameMotions(motion)
    found = np.zeros((len(seeds), len(question.recipe.moments.targets)), int)
    ground = []
    for k, seed in enumerate(seeds):
        scanner = Scanner(twin.mesh, rig, seed, surface=twin.surface_materials)
        for number, moment in enumerate(question.recipe.moments.every):
            around = motions.around(moment.time_s, 0.0, 0.11)
            frame = scanner.scan(moment.index, posed_actors(around.rows, around.paths()))
            points = {box.track: box.num_points for box in frame.boxes}
            for row in np.flatnonzero(question.recipe.moments.targets.moment == number):
                found[k, row] = points[int(question.recipe.moments.targets.track[row])]
            ground.append((frame.points[:, :3], frame.semantic))
    return found, ground


@pytest.fixture(scope="module")
def pair(question, casts):
    """A layout of two sensors that look at the junction from two corners."""
    views = question.views
    layout = tuple(sorted((views.chosen(0, 1, 0, 1, 0), views.chosen(1, 0, 0, 0, 0))))
    return layout, casts.of(layout), recorded(question, layout, (5, 6))


def test_expected_points_are_those_of_recordings(pair):
    _, sightings, (points, _) = pair
    expected = np.sum([one.points for one in sightings], axis=0)
    assert expected.sum() > 500
    # Each of n beams returns or not: binomial, so narrower than Poisson. A point may also leave
    # its box when ranges are measured, which is counted in recordings alone.
    for one in points:
        assert abs(one.sum() - expected.sum()) < 4 * np.sqrt(expected.sum()) + 0.01 * expected.sum()
        assert (np.abs(one - expected) <= 5 * np.sqrt(expected) + 3).all()
    assert np.corrcoef(points[0], expected)[0, 1] > 0.999


def test_points_of_a_layout_are_the_sum_of_its_sensors(question, pair):
    layout, sightings, _ = pair
    for number, sighting in zip(layout, sightings, strict=True):
        (alone,), _ = recorded(question, (number,), (5,))
        assert abs(alone.sum() - sighting.points.sum()) < 4 * np.sqrt(sighting.points.sum()) + 5


def test_points_on_the_ground_are_those_of_recordings(question, pair):
    _, sightings, (_, frames) = pair
    squares = question.recipe.squares
    walked = [one.id for one in semantic_classes().values() if one.name in ("road", "sidewalk")]
    counts = np.zeros(len(squares.crossing))
    for points, semantic in frames:
        number = squares.ground.numbers(points[np.isin(semantic, walked), :2].astype(float))
        counts += np.bincount(number[number >= 0], minlength=len(counts))
    counts /= len(frames)
    expected = np.sum([one.ground for one in sightings], axis=0)
    # Traffic stands on some squares, and none when views look at the ground.
    free = expected > 3
    assert free.sum() > 50
    assert np.median(np.abs(counts[free] / expected[free] - 1)) < 0.1


def test_who_is_hidden_by_what(question, casts):
    """The truck stands between the far corner and the car beside it."""
    views = question.views
    seen = [casts.of((n,))[0] for n, one in enumerate(views.every) if one.mount == 0]
    targets = question.recipe.moments.targets
    car = targets.track == 3
    low = min(seen, key=lambda one: one.points[car].sum())
    # From the south-east, the truck takes points from the car that stands north of it.
    assert low.alone[car].sum() > low.points[car].sum()
    assert (low.blocker[car] == 2).any()
    hidden = {one.track: one for one in hidden_actors(question.recipe.moments, [low])}
    for one in hidden.values():
        rows = (targets.track == one.track) & (low.points < 4.5)
        assert one.seconds == pytest.approx(rows.sum() * question.recipe.moments.step_s)
        assert one.behind[0]


def test_a_wall_is_told_by_its_class(question, motion, two_avenues_twin, tmp_path):
    """A wall before the corner hides everybody, and is named."""
    from dataclasses import replace

    from urbantwin.studies.placement.sighting import Caster
    from urbantwin.taxonomy import material_id, semantic_id

    x, y = 12.0, -12.0
    wall = LabelledMesh.build(
        [[x - 9, y - 9, -5], [x + 9, y + 9, -5], [x + 9, y + 9, 30], [x - 9, y - 9, 30]],
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("other-structure"),
        material_id("concrete"),
    )
    recipe = question.recipe
    walled = replace(recipe, mesh=LabelledMesh.concatenate([recipe.mesh, wall]))
    number = question.views.chosen(0, 1, 0, 0, 0)
    mounted = question.views.hung(number, recipe.models)
    caster = Caster(walled)
    sighting = caster.cast(mounted, 0)
    assert sighting.points.sum() < 0.05 * caster_free(question, recipe, mounted)
    hidden = hidden_actors(question.recipe.moments, [sighting])
    assert {one.track for one in hidden} == {1, 2, 3, 4}
    assert hidden[0].seconds == pytest.approx(
        len(question.recipe.moments.every) * question.recipe.moments.step_s
    )
    assert "a structure" in {one.behind[0] for one in hidden}


def caster_free(question, recipe, mounted):
    """Return the points without the wall."""
    from urbantwin.studies.placement.sighting import Caster

    return float(Caster(recipe).cast(mounted, 0).points.sum())


def test_what_is_half_written_is_cast_again(casts, question):
    number = question.views.chosen(2, 0, 0, 0, 0)
    first = casts.of((number,))[0]
    path = casts.path(number)
    kept = read_sighting(path)
    assert kept is not None
    assert all(np.array_equal(a, b) for a, b in zip(first, kept, strict=True))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert read_sighting(path) is None
    path.write_bytes(whole)


def test_voxels_are_occupied_as_often_as_boxes_hold_their_middles(question):
    targets, moments = question.recipe.moments.targets, len(question.recipe.moments.every)
    voxels = occupied_voxels(targets, moments, 1.0)
    # The driving car is at each place for a part of the time; the truck never leaves, and what
    # is certain has no entropy.
    places = np.argwhere(voxels.number >= 0)
    middles = voxels.low + (places + 0.5) * voxels.edge_m
    count = np.zeros((moments, len(places)), bool)
    for row in range(len(targets)):
        offset = middles - targets.middle[row]
        c, s = np.cos(targets.yaw[row]), np.sin(targets.yaw[row])
        along, aside = offset[:, 0] * c + offset[:, 1] * s, offset[:, 1] * c - offset[:, 0] * s
        half = targets.size[row] / 2
        inside = (np.abs(along) <= half[0]) & (np.abs(aside) <= half[1])
        count[targets.moment[row]] |= inside & (np.abs(offset[:, 2]) <= half[2])
    p = count.mean(axis=0)
    assert ((p > 0) & (p < 1)).all()
    expected = -p * np.log(p) - (1 - p) * np.log1p(-p)
    order = voxels.number[tuple(places.T)]
    assert voxels.entropy[order] == pytest.approx(expected)
    truck = targets.middle[targets.track == 2][0]
    assert voxels.number[tuple(((truck - voxels.low) / voxels.edge_m).astype(int))] == -1


def test_beams_pass_the_voxels_that_points_on_them_lie_in(question):
    voxels = question.recipe.voxels
    random = np.random.default_rng(0)
    origin = np.array([14.0, -14.0, 6.0])
    places = np.argwhere(voxels.number >= 0)[random.integers(0, len(voxels.entropy), 60)]
    aims = voxels.low + (places + random.random((60, 3))) * voxels.edge_m - origin
    aims /= np.linalg.norm(aims, axis=1)[:, None]
    reach = random.uniform(5, 60, 60)
    passed = passed_voxels(voxels, origin, aims, reach)
    sampled = np.zeros_like(passed)
    for aim, far in zip(aims, reach, strict=True):
        points = origin + np.arange(0, far, 0.002)[:, None] * aim
        cell = np.floor((points - voxels.low) / voxels.edge_m).astype(int)
        inside = ((cell >= 0) & (cell < voxels.number.shape)).all(axis=1)
        number = voxels.number[tuple(cell[inside].T)]
        sampled[number[number >= 0]] = True
    assert passed.sum() > 20
    assert not (sampled & ~passed).any()
    # Corners that are cut by less than the step of the samples.
    assert (passed & ~sampled).sum() <= 0.02 * passed.sum() + 1
