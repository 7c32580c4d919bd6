"""Lines of sight past boxes against Open3D."""

import numpy as np
import open3d as o3d

from urbantwin.lidar.sight import LineOfSight

HERE = np.array([0.5, -1.0, 4.0])


def test_the_box_that_ends_a_line_is_that_of_open3d():
    rng = np.random.default_rng(3)
    boxes = np.column_stack(
        [
            rng.uniform(-150, 150, (60, 2)),
            rng.uniform(0.5, 2, 60),
            rng.uniform(0.5, 12, (60, 3)),
            rng.uniform(-4, 4, 60),
        ]
    )
    boxes = boxes[np.linalg.norm(boxes[:, :2], axis=1) > 15]
    scene, number = o3d.t.geometry.RaycastingScene(), {}
    for row, (x, y, z, length, width, height, yaw) in enumerate(boxes):
        mesh = o3d.geometry.TriangleMesh.create_box(length, width, height)
        mesh.translate((-length / 2, -width / 2, -height / 2))
        mesh.rotate(o3d.geometry.get_rotation_matrix_from_xyz((0, 0, yaw)), center=(0, 0, 0))
        mesh.translate((x, y, z))
        number[scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))] = row
    targets = np.vstack([boxes[:, :3], boxes[:, :3] + rng.normal(0, 2, (len(boxes), 3))])
    sight = LineOfSight.past_boxes(boxes, HERE[:2])
    hits, away = sight.towards(HERE, targets)
    aims = (targets - HERE) / np.linalg.norm(targets - HERE, axis=1)[:, None]
    rays = np.column_stack([np.broadcast_to(HERE, aims.shape), aims]).astype(np.float32)
    cast = scene.cast_rays(o3d.core.Tensor(rays))
    expected_m = cast["t_hit"].numpy()
    np.testing.assert_allclose(hits.range_m, expected_m, atol=1e-3)
    np.testing.assert_allclose(away, np.linalg.norm(targets - HERE, axis=1))
    hit = np.isfinite(expected_m)
    owner = [number[one] for one in cast["geometry_ids"].numpy()[hit].tolist()]
    assert sight.mesh.part[hits.face[hit]].tolist() == owner
    assert (sight.sees(HERE, targets) == (expected_m >= away - 0.3)).all()
    assert 0 < sight.sees(HERE, targets).sum() < len(targets)
