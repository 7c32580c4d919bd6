"""Boxes against the meshes that they bound, spans against points on the ray."""

import numpy as np
import pytest

from urbantwin.geometry import Pose, bounding_box, points_in_box
from urbantwin.lidar.compiled.boxes import tight_boxes
from urbantwin.lidar.compiled.carried import span_in_box
from urbantwin.lidar.shapes import ActorShape
from urbantwin.traffic.assets import asset_mesh, asset_names


def tight_box(mesh, pose):
    """The box of one mesh, between the hulls of others."""
    hull, other = ActorShape(mesh).hull, np.full((3, 5), 9.0)
    several = tuple(np.concatenate([other, hull, other], axis=1))
    return tight_boxes(
        pose.rotation[None], pose.translation[None], several, np.array([5]),
        np.array([hull.shape[1]]),
    )[0]  # fmt: skip


@pytest.mark.parametrize("actor_class", ["car", "truck", "pedestrian"])
@pytest.mark.parametrize(
    "angles", [(0, 0, 0), (2.5, 0.06, -0.04), (-1.1, -0.3, 0.4), (0.7, 1.5, 3.0)]
)
def test_box_is_the_tight_bounds_of_every_posed_vertex(actor_class, angles):
    mesh = asset_mesh(asset_names(actor_class)[0], 0)
    pose = Pose.from_ypr((40, -13, 2), *angles)
    box = tight_box(mesh, pose)
    np.testing.assert_allclose(box, bounding_box(mesh.transformed(pose).vertices, angles[0]))


def test_box_of_a_flat_mesh(ground_mesh):
    box = tight_box(ground_mesh(half=2.0), Pose.from_ypr((1, 2, 3), 0.5))
    np.testing.assert_allclose(box, [1, 2, 3, 4, 4, 0, 0.5], atol=1e-12)


def test_spans_are_where_points_of_the_ray_are_inside():
    rng = np.random.default_rng(2)
    origin = np.array([-3.0, 1.0, 5.0])
    boxes = np.column_stack(
        [
            rng.uniform(-8, 8, (300, 3)),
            rng.uniform(1, 5, (300, 3)),
            rng.uniform(-3, 3, 300),
        ]
    )
    aims = boxes[:, :3] + rng.uniform(-0.4, 0.4, (300, 3)) - origin
    aims /= np.linalg.norm(aims, axis=1, keepdims=True)
    aims[0] = [1, 0, 0]
    boxes[0] = [5, 1, 5, 2, 2, 2, 0]  # A ray that runs along its box's axis.
    turned = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    spans = [span_in_box(origin, aim, boxes, n, *turned, 0.015) for n, aim in enumerate(aims)]
    enter, leave = np.array(spans).T
    for step in np.linspace(0, 20, 801):
        inside = np.array(
            [
                points_in_box((origin + aim * step)[None], box, 0.015)[0]
                for aim, box in zip(aims[:40], boxes[:40], strict=True)
            ]
        )
        spanned = (step > enter[:40]) & (step < leave[:40])
        np.testing.assert_array_equal(inside, spanned)
