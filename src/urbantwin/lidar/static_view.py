"""The static world as one sensor sees it in one turn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose
from urbantwin.lidar.background_view import (
    SeveralRanges,
    measured_answers,
    measured_layers,
    several_ranges,
)
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.tracer import SensorPoses
from urbantwin.lidar.compiled.view import answer_beams, turn_directions
from urbantwin.lidar.echoes import Answers, Echoes, static_echoes
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.returns.strays import Source, Spill, is_bright, spilled
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sensor_path import SensorPath
from urbantwin.lidar.static_world import StaticLayers, World
from urbantwin.lidar.timing import Sweep

__all__ = ["StaticAnswers", "StaticView"]


class StaticAnswers(NamedTuple):
    """Responses of N beams to the static world.

    Attributes:
        first: (N,) responses to the first echo of each beam.
        other: (N,) int32, index of the second echo among ``second``; -1 for none.
        second: (O,) responses to the second echoes.
    """

    first: Answers
    other: NDArray[np.int32]
    second: Answers


@dataclass(frozen=True, eq=False)
class StaticView:
    """Responses of a sensor to the static world, by beam.

    Attributes:
        beams: beams of the sensor.
        poses: true poses.
        layers: layers of the static world along the beams.
        directions: (3, N) float32, reported directions, dataset frame.
        origin: (3, K) float32, reported origin of each column's beams, or (3, 1).
        answers: responses of the beams.
        amplitude: (N,) float32, of the first echo; 0 for none.
        bright: (B,) int32, beams whose echo is brighter than white.
        measured: (N,) beams with a measured background, with its drop-out, noise and intensity;
            ``None`` for none.
        several: those of them with several ranges.
        halo: stray light of the bright beams; ``None`` if not computed in advance.
    """

    beams: Beams
    poses: SensorPoses
    layers: StaticLayers
    directions: NDArray[np.float32]
    origin: NDArray[np.float32]
    answers: StaticAnswers
    amplitude: NDArray[np.float32]
    bright: NDArray[np.int32]
    measured: NDArray[np.bool_] | None = None
    several: SeveralRanges | None = None
    halo: Spill | None = None

    def drawn(
        self, seed: int, turn: int, time_s: float, draws: NDArray[np.uint16]
    ) -> tuple[StaticView, NDArray[np.int64]]:
        """Draw the surfaces of beams with several ranges for one turn.

        Args:
            seed: random seed.
            turn: number of the turn.
            time_s: start of the turn.
            draws: (N,) uniform draws of the beams.

        Returns:
            The view of that turn, and the beams that hit vegetation and certainly return.
        """
        if self.several is None or self.measured is None:
            return self, np.zeros(0, np.int64)
        which = self.several.drawn(seed, turn, time_s, draws)
        layers, first, stirred = self.several.seen(which, self.layers, self.answers.first)
        measured = self.measured.copy()
        measured[stirred] = True
        answers = self.answers._replace(first=first)
        return replace(self, layers=layers, answers=answers, measured=measured, halo=None), stirred

    def as_measured(self, echoes: Echoes) -> None:
        """Give echoes of measured surfaces before or beside actors their measured properties."""
        if self.measured is None:
            return
        row = np.flatnonzero(echoes.owner < 0)
        beam = np.repeat(echoes.beam, np.diff(echoes.start))[row]
        whole = np.abs(echoes.range_m[row] - self.layers.range_m[-1 - echoes.owner[row]]) < 1e-3
        row, beam = row[whole & self.measured[beam]], beam[whole & self.measured[beam]]
        first = self.answers.first
        echoes.level[row], echoes.sigma[row] = first.level[beam], first.sigma[beam]
        echoes.intensity[row] = first.intensity[beam]

    def believed_from(self, path: SensorPath, time_s: float, dataset_SE3_site: Pose) -> StaticView:
        """Return the view of a fixed sensor with another reported pose.

        Args:
            path: path with the reported poses.
            time_s: time within the frame.
            dataset_SE3_site: to the frame of the points.
        """
        rotation, place = path.reported_poses(np.array([time_s]))
        turned = np.asarray(dataset_SE3_site.rotation) @ rotation
        directions = _directions(self.beams, self.beams.believed, turned)
        origin = np.ascontiguousarray(dataset_SE3_site.apply(place).T, np.float32)
        return replace(self, directions=directions, origin=origin)

    @classmethod
    def of(
        cls,
        mounted: MountedSensor,
        beams: Beams,
        model: ReturnModel,
        world: World,
        path: SensorPath,
        sweep: Sweep,
        dataset_SE3_site: Pose,
    ) -> StaticView:
        """Cast the beams at the static world.

        Args:
            mounted: the sensor.
            beams: its beams in this turn.
            model: its return model.
            world: the static world.
            path: path of the sensor.
            sweep: firing times of the beams.
            dataset_SE3_site: to the frame of the points.
        """
        times = sweep.column_time_s[:1] if path.is_fixed else sweep.column_time_s
        # Writable copies for every kind of path: numba compiles for one type of array.
        poses = SensorPoses(*(np.array(part, order="C") for part in path.true_poses(times)))
        # A fixed sensor is cast once, so at full footprint.
        kept = path.is_fixed and beams.rings is not None
        layers = world.layers(beams, sweep, poses, model, thorough=kept)
        measured = mounted.measured if kept else None
        several = None
        share = beams.footprint.share
        if measured is not None:
            several = several_ranges(measured, layers, model, mounted.effects)
            level = None
            if measured.fused:
                level = _strongest_levels(static_echoes(layers, share, model, mounted.returns))
            layers = measured_layers(measured, layers, model, len(share), level, several)
        echoes = static_echoes(layers, share, model, mounted.returns)
        has = echoes.first >= 0
        answers, amplitude = _answers(echoes, layers, echoes.first)
        if measured is not None:
            answers = measured_answers(measured, answers, has, mounted.effects, mounted.missing)
        also = np.flatnonzero(echoes.second >= 0)
        other = np.full(len(has), -1, np.int32)
        other[also] = np.arange(len(also), dtype=np.int32)
        second = _answers(echoes, layers, echoes.second[also])[0]
        rotation, place = path.reported_poses(times)
        turned = np.asarray(dataset_SE3_site.rotation) @ rotation
        bright = np.flatnonzero(is_bright(amplitude)).astype(np.int32)
        halo = None
        if kept and beams.rings is not None and mounted.effects.blooming:
            source = Source(bright, answers.range_m[bright], amplitude[bright])
            halo = spilled(model, mounted.sensor, beams, beams.rings, source)
        return cls(
            beams,
            poses,
            layers,
            _directions(beams, beams.believed, turned),
            np.ascontiguousarray(dataset_SE3_site.apply(place).T, np.float32),
            StaticAnswers(answers, other, second),
            amplitude,
            bright,
            None if measured is None else measured.known & has,
            several,
            halo,
        )


def _directions(
    beams: Beams, directions: NDArray[np.float64], rotation: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return directions (3, N) of beams, rotated by their columns' rotations (K or 1, 3, 3)."""
    if len(rotation) == 1:
        return np.ascontiguousarray((rotation[0] @ directions.T), np.float32)
    out = np.empty((3, len(directions)), np.float32)
    turn_directions(directions, rotation, out)
    return out


def _strongest_levels(echoes: Echoes) -> NDArray[np.int32]:
    """Return the detection level (N,) of the first echo, of 65,536; 0 without one."""
    level = np.zeros(len(echoes.first), np.int32)
    has = echoes.first >= 0
    level[has] = echoes.level[echoes.first[has]]
    return level


def _answers(
    echoes: Echoes, layers: StaticLayers, which: NDArray[np.int32]
) -> tuple[Answers, NDArray[np.float32]]:
    """Return responses and amplitudes of echoes (N,) by index, -1 for none.

    Without an echo all values are 0; the class is unlabelled.
    """
    count = len(which)
    answers = Answers(
        np.empty(count, np.int32),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
        np.empty(count, np.uint16),
    )
    amplitude = np.empty(count, np.float32)
    answer_beams(echoes, layers.semantic, which, answers, amplitude)
    return answers, amplitude
