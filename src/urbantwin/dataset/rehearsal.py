"""A frame that nobody asked for: who scanned it has imported and loaded what recording needs."""

from __future__ import annotations

__all__ = ["rehearse"]


def rehearse() -> None:
    """Scan a board on a plane; it is no car, as motions have the meshes of their actors.

    Helpers do so while the twin is opened. All else is imported here and not above: the process
    that starts them needs the name of this function alone.
    """
    import numpy as np

    import urbantwin.dataset.workers  # noqa: F401 - with what records frames
    from urbantwin.dataset.layout import FrameTables
    from urbantwin.geometry import LabelledMesh, Pose
    from urbantwin.lidar import PosedActor, Scanner, place_rig
    from urbantwin.site.rig import RigSpec, SensorSpec
    from urbantwin.taxonomy import material_id, semantic_id

    corners = np.array(
        [[-60.0, -60.0, 0.0], [60.0, -60.0, 0.0], [60.0, 60.0, 0.0], [-60.0, 60.0, 0.0]]
    )
    plane = LabelledMesh.build(
        corners, np.array([[0, 1, 2], [0, 2, 3]]), semantic_id("road"), material_id("asphalt")
    )
    sensor = SensorSpec(name="rehearsal", model="VLP-16", east_m=0.0, north_m=0.0, height_m=4.0)
    rig = place_rig(RigSpec(sensors=[sensor]), plane)
    board = LabelledMesh.build(
        np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 2.0], [0.0, -1.0, 2.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        semantic_id("car"),
        material_id("paint-white"),
    )
    pose = Pose(np.eye(3), np.array([10.0, 3.0, 0.0]))
    actor = PosedActor(1, "car", "board", 0, pose, np.array([8.0, 0.0, 0.0]))
    frame = Scanner(plane, rig, 0, meshes=lambda _asset, _phase: board).scan(0, [actor])
    FrameTables.of(frame)
