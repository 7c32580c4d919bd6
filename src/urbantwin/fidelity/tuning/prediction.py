"""Predicted returns of a sensor from the static world, per beam, for any calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.geometry.rays import RayScene
from urbantwin.lidar import Rig
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.returns import LEVELS, ReturnModel
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.static_view import StaticView
from urbantwin.lidar.static_world import World
from urbantwin.lidar.timing import Sweep
from urbantwin.site.rig import Conditions
from urbantwin.taxonomy import materials

__all__ = ["Answers", "BeamView", "beam_view"]


@dataclass(frozen=True, eq=False)
class Answers:
    """The predicted returns of N beams.

    Attributes:
        share: (N,) probability of a return.
        sigma_m: (N,) standard deviation of the range, quantisation included.
        intensity: (N,) 0..1.
    """

    share: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    intensity: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BeamView:
    """Surfaces hit by the beams of one sensor, cast once for all trials.

    Attributes:
        mounted: the sensor at its pose.
        conditions: weather and sun.
        columns: columns per rotation; beam = channel * columns + column.
        directions: (N, 3) nominal beam directions, sensor frame.
        range_m: (N,) range of the first echo; 0 without an echo.
        amplitude: (N,) amplitude of the first echo, with nominal reflectivities.
        peak: (N,) remaining share of the pulse's peak, see ``lidar.returns.model``.
        material: (N,) material at the centre of the beam; -1 for none.
        face: (N,) triangle there; -1 for none.
    """

    mounted: MountedSensor
    conditions: Conditions
    columns: int
    directions: NDArray[np.float64]
    range_m: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    peak: NDArray[np.float32]
    material: NDArray[np.int64]
    face: NDArray[np.int64]

    def answers(self, mounted: MountedSensor, beams: NDArray[np.int64]) -> Answers:
        """Return the predicted returns of some beams with another calibration or reflectivity.

        Args:
            mounted: the sensor with its calibration and reflectivity factors.
            beams: (N,) beam indices.
        """
        model = ReturnModel(mounted, self.conditions)
        times = _factors(mounted)[self.material[beams]]
        level, sigma, intensity, _ = model.answers(
            (self.amplitude[beams] * times).astype(np.float32),
            self.range_m[beams],
            peak=self.peak[beams],
        )
        step = float(model.step_m)
        return Answers(
            level / float(LEVELS) * (1.0 - mounted.missing),
            np.sqrt(sigma.astype(np.float64) ** 2 + step**2 / 12),
            intensity.astype(np.float64),
        )


def beam_view(
    rig: Rig, number: int, mesh: LabelledMesh, surface: SurfaceMaterials | None, seed: int
) -> BeamView:
    """Cast the beams of one fixed sensor.

    Args:
        rig: the rig with its sensors at their poses.
        number: index of the sensor.
        mesh: the static world, site frame.
        surface: ground materials finer than the mesh.
        seed: seed of all random numbers.
    """
    plain = replace(rig.sensors[number], reflectivity={})
    beams = Beams.of(plain)
    model = ReturnModel(plain, rig.conditions)
    place = plain.site_SE3_sensor
    view = StaticView.of(
        plain,
        beams,
        model,
        World(mesh, place.translation, surface, tracer_on()),
        replace(plain, sway=None).path(0, seed),
        Sweep.snapshot(plain.columns, plain.sensor.channels),
        rig.dataset_SE3_site,
    )
    aim = beams.directions @ place.rotation.T
    caster = RayScene(mesh.vertices - place.translation, mesh.faces)
    hits = caster.cast(np.zeros(3), aim.astype(np.float32))
    material = np.full(len(aim), -1, np.int64)
    hit = np.flatnonzero(hits.face >= 0)
    face = hits.face[hit]
    material[hit] = mesh.material[face]
    peak = np.ones(len(aim), np.float32)
    cosine = np.abs((mesh.normals(face) * aim[hit]).sum(axis=1)).astype(np.float32)
    peak[hit] = model.peak_left(hits.range_m[hit], cosine)
    if surface is not None and surface.layers:
        places = place.translation + aim[hit] * hits.range_m[hit, None].astype(np.float64)
        material[hit] = surface.materials_of(mesh, face, places)
    return BeamView(
        plain,
        rig.conditions,
        beams.columns,
        beams.believed,
        view.answers.first.range_m,
        view.amplitude,
        peak,
        material,
        hits.face.astype(np.int64),
    )


def _factors(mounted: MountedSensor) -> NDArray[np.float64]:
    """Return the reflectivity factor of each material, and 1 for no material."""
    names = list(materials())
    found = np.ones(len(names) + 1)
    for name, times in mounted.reflectivity.items():
        found[names.index(name)] = times
    return found
