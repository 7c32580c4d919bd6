"""Warm-up of a process: imports and compiled functions that recording needs."""

from __future__ import annotations

__all__ = ["rehearse"]


def rehearse() -> None:
    """Walk, and scan a board on a plane: numba loads, or compiles, what that needs.

    A board stands in for a car, because motions bring the meshes of their actors. Helpers do so
    while the twin is built or opened. Imports are local: the process that starts helpers needs only
    this function's name.
    """
    _walk()
    _scan()


def _walk() -> None:
    """Let two people walk: their functions compile longest, and are needed before any frame."""
    import numpy as np
    import shapely

    from urbantwin.traffic.paths.box_plan import PlanBoxes
    from urbantwin.traffic.paths.crowd import crowd_walked
    from urbantwin.traffic.paths.separation import Moving
    from urbantwin.traffic.paths.walked_ground import WalkedGround

    step = np.zeros(2, np.int64)
    actor, level, half = np.arange(2), np.zeros(2, np.int64), np.full((2, 2), 0.3)
    columns = {
        "step": step,
        "xy": np.array([[0.0, 0.0], [5.0, 0.0]]),
        "yaw": np.zeros(2),
        "speed": np.ones(2),
        "distance": np.zeros(2),
        "lane": level,
    }
    boxes = PlanBoxes(step, columns["xy"], columns["yaw"], half)
    people = ("pedestrian", "pedestrian")
    moving = Moving(actor, boxes, columns["speed"], level, level, people, actor)
    nothing = PlanBoxes(step[:0], columns["xy"][:0], columns["yaw"][:0], half[:0])
    solids, footway = np.array([], np.object_), shapely.box(-9, -9, 9, 9)
    ground = WalkedGround(columns["xy"], nothing, solids, footway)
    crowd_walked(columns, moving, half, 0.1, ground)


def _scan() -> None:
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
