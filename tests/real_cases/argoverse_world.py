"""The Argoverse log as a world for the simulator: the measured ground, and boxes as actors.

Nothing else stands there: what the log does not describe (houses, trees, poles, signs) is missing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import trimesh

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import LabelledFrame, MountedSensor, PosedActor, Rig, Scanner
from urbantwin.lidar.actor_path import ActorPath
from urbantwin.site.rig import Effects, OutageSpec, RideSpec
from urbantwin.taxonomy import ACTOR_SEMANTICS, material_id, semantic_id
from urbantwin.traffic.assets import (
    COATED_CLASSES,
    asset,
    asset_mesh,
    asset_names,
    coated_mesh,
)

from .argoverse_log import COLUMNS, SENSORS, ActorBox, Log, vlp32c

__all__ = ["World", "actor_class", "mesh_in_box", "meshes_of", "numbers", "numbers_of"]

#: Classes of the log and ours whose meshes stand for them.
CLASSES = {
    "REGULAR_VEHICLE": "car",
    "LARGE_VEHICLE": "truck",
    "BOX_TRUCK": "truck",
    "TRUCK": "truck",
    "TRUCK_CAB": "truck",
    "VEHICULAR_TRAILER": "truck",
    "BUS": "bus",
    "BICYCLE": "bicycle",
    "BICYCLIST": "bicycle",
    "MOTORCYCLE": "motorcycle",
    "MOTORCYCLIST": "motorcycle",
    "PEDESTRIAN": "pedestrian",
}
#: Two-wheelers that nobody rides.
PARKED = ("BICYCLE", "MOTORCYCLE")
#: Ground farther from the vehicle is left out.
FARTHEST_M = 120.0
#: Nodes of the vehicle's path, seconds after the sweep's time.
TIMES_S = np.linspace(0.0, 0.12, 7)
#: Track of the vehicle that carries the sensors.
EGO = 60000
#: What the vehicle itself hides from its sensors (its roof, and what stands on it), by where
#: neither sweep has any return though others see the ground there.
HIDDEN = {
    "up_lidar": (OutageSpec(channels=[0], sector_deg=[150, 211]),),
    "down_lidar": (
        OutageSpec(sector_deg=[153, 168]),
        # In its own frame: hanging, it sees the sky below 0.
        OutageSpec(
            channels=np.flatnonzero(vlp32c("ccw").elevation_deg < 1.7).tolist(),
            sector_deg=[153, 180],
        ),
        OutageSpec(
            channels=np.flatnonzero(vlp32c("ccw").elevation_deg < 3.5).tolist(),
            sector_deg=[171, 177],
        ),
    ),
}
_RIDER = ("cloth", "skin")


def actor_class(category: str) -> str:
    """Ours for a category of the log; small things stand in for people."""
    return CLASSES.get(category, "pedestrian")


def mesh_in_box(
    category: str,
    size: np.ndarray,
    coat: str | None = None,
    name: str | None = None,
    *,
    panes: bool = True,
) -> LabelledMesh:
    """A mesh of the class scaled to fill a box around 0.

    Args:
        category: of the log.
        size: (3,) of the box.
        coat: of a vehicle.
        name: of the mesh; without it the one whose proportions come nearest.
        panes: without, what is glass is painted: a van of sheet metal.
    """
    meshes = meshes_of(category)
    if not meshes:
        return _plain(category, size)
    if name is None:
        name = min(
            (float(np.abs(np.log(size / _extent(mesh))).sum()), key) for key, mesh in meshes.items()
        )[1]
    mesh = meshes[name]
    if not panes:
        glass = mesh.material == material_id("glass")
        material = np.where(glass, material_id("metal-painted"), mesh.material)
        mesh = replace(mesh, material=material.astype(mesh.material.dtype))
    if coat is not None and actor_class(category) in COATED_CLASSES:
        mesh = coated_mesh(mesh, coat)
    used = mesh.vertices[np.unique(mesh.faces)]
    scaled = (mesh.vertices - (used.min(axis=0) + used.max(axis=0)) / 2) * (size / _extent(mesh))
    return LabelledMesh(scaled, mesh.faces, mesh.semantic, mesh.material, mesh.part)


def meshes_of(category: str) -> dict[str, LabelledMesh]:
    """The catalogue's meshes of a class of the log; none of things that are in no catalogue."""
    if category not in CLASSES:
        return {}
    found = {}
    for name in asset_names(actor_class(category)):
        mesh = asset_mesh(name, asset(name).standing)
        found[name] = mesh.select(~_of_rider(mesh)) if category in PARKED else mesh
    return found


def _extent(mesh: LabelledMesh) -> np.ndarray:
    return np.asarray(np.ptp(mesh.vertices[np.unique(mesh.faces)], axis=0))


def _of_rider(mesh: LabelledMesh) -> np.ndarray:
    """Which triangles belong to solids with cloth or skin, the rider's, or that touch them."""
    rider = np.isin(mesh.material, [material_id(name) for name in _RIDER])
    return np.isin(mesh.part, np.unique(mesh.part[rider]))


def _plain(category: str, size: np.ndarray) -> LabelledMesh:
    """A bollard, a cone, or a box for whatever else."""
    if category in ("BOLLARD", "CONSTRUCTION_CONE", "CONSTRUCTION_BARREL"):
        build = trimesh.creation.cone if "CONE" in category else trimesh.creation.cylinder
        shape = build(radius=0.5, height=1.0, sections=24)
    else:
        shape = trimesh.creation.box()
    low, high = shape.bounds
    vertices = (shape.vertices - (low + high) / 2) / (high - low) * size
    semantic = semantic_id(ACTOR_SEMANTICS["pedestrian"])
    return LabelledMesh.build(vertices, shape.faces, semantic, material_id("plastic"), 1)


@dataclass(frozen=True, eq=False)
class World:
    """A sweep's world, site frame = vehicle frame at the sweep's time."""

    log: Log
    sweep: int

    @cached_property
    def ground(self) -> LabelledMesh:
        """The measured ground up to `FARTHEST_M` from the vehicle, as asphalt."""
        vertices, faces = self.log.ground(self.sweep, FARTHEST_M)
        return LabelledMesh.build(vertices, faces, semantic_id("road"), material_id("asphalt"))

    def rig(self, effects: Effects) -> Rig:
        """Both sensors where they are on the vehicle, in the phase that they were in."""
        sensors = [
            MountedSensor(
                name,
                vlp32c(spin),
                COLUMNS,
                self.log.mounts[name],
                effects,
                number=number,
                phase_deg=self.log.rays(self.sweep, name).phase_deg,
                outages=HIDDEN[name],
                carrier_SE3_sensor=self.log.mounts[name],
            )
            for number, (name, _, spin) in enumerate(SENSORS)
        ]
        nowhere = Pose.from_ypr(np.zeros(3))
        return Rig(tuple(sensors), "site", 10.0, nowhere, ride=RideSpec(track=EGO), carrier=EGO)

    def actors(self, boxes: list[ActorBox]) -> list[PosedActor]:
        """The vehicle that carries the sensors, and the boxes; the n-th has the track n."""
        poses = self.log.vehicle_path(self.sweep, TIMES_S)
        way = ActorPath(
            TIMES_S,
            np.stack([pose.rotation for pose in poses]),
            np.stack([pose.translation for pose in poses]),
        )
        found = [PosedActor(EGO, "car", "ego", 0, poses[0], np.zeros(3), way)]
        for track, box in enumerate(boxes, 1):
            start = box.pose.translation - box.observed_s * box.velocity
            pose = Pose(box.pose.rotation, start)
            kind = actor_class(box.category)
            found.append(PosedActor(track, kind, str(track), 0, pose, box.velocity))
        return found

    def scan(self, boxes: list[ActorBox], effects: Effects, seed: int = 0) -> LabelledFrame:
        """The frame that the simulated rig sees."""
        meshes = {
            str(n): mesh_in_box(box.category, box.size, box.coat, box.mesh, panes=box.panes)
            for n, box in enumerate(boxes, 1)
        }
        scanner = Scanner(
            self.ground, self.rig(effects), seed, meshes=lambda name, phase: meshes[name]
        )
        return scanner.scan(self.log.sweeps.index(self.sweep), self.actors(boxes))

    def ranges(self, frame: LabelledFrame) -> np.ndarray:
        """Distances (N,) of points from where their sensor was when it measured them."""
        poses = self.log.vehicle_path(self.sweep, TIMES_S)
        found = np.empty(len(frame.points))
        for number, (name, *_) in enumerate(SENSORS):
            mine = frame.sensor == number
            place = np.stack([(pose @ self.log.mounts[name]).translation for pose in poses])
            time_s = frame.time_s[mine]
            origin = np.column_stack([np.interp(time_s, TIMES_S, place[:, k]) for k in range(3)])
            found[mine] = np.linalg.norm(frame.points[mine, :3] - origin, axis=1)
        return found


def numbers(frame: LabelledFrame) -> list[np.ndarray]:
    """Per sensor which point (C, K) each of its rays gave; -1 for none."""
    return numbers_of(frame.sensor, frame.ring, frame.column)


def numbers_of(sensor: np.ndarray, ring: np.ndarray, column: np.ndarray) -> list[np.ndarray]:
    """Per sensor which point (C, K) each of its rays gave, by points' (N,) rays; -1 for none."""
    found = []
    for number, (_, _, spin) in enumerate(SENSORS):
        image = np.full((vlp32c(spin).channels, COLUMNS), -1)
        mine = np.flatnonzero(sensor == number)
        image[ring[mine], column[mine]] = mine
        found.append(image)
    return found
