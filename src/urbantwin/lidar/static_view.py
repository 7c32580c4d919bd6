"""The static world as one sensor sees it in one turn, and what it would report of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.echoes import Echoes, combined
from urbantwin.lidar.layers import SensorPoses
from urbantwin.lidar.measured import SeveralRanges
from urbantwin.lidar.mounted import MountedSensor
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.returns.strays import is_bright
from urbantwin.lidar.sensor_path import SensorPath
from urbantwin.lidar.static import StaticLayers, World
from urbantwin.lidar.sweep import Sweep

__all__ = ["StaticView"]


@dataclass(frozen=True, eq=False)
class StaticView:
    """What a sensor reports of the static world, beam by beam.

    Attributes:
        beams: of the sensor.
        poses: where it truly is.
        layers: what its beams meet.
        directions: (3, N) float32, where its points are believed to lie, dataset frame.
        origin: (3, K) float32, where each column's beams are believed to leave, or (3, 1).
        report: level (N,) int32, range, sigma and intensity (N,) float32, semantic (N,) uint16 of
            the first echo; its range is 0 where there is none.
        other: (N,) int32, number of the second echo of each beam, -1 for none.
        second: the same five of the second echoes.
        amplitude: (N,) float32, of the first echo; 0 where there is none.
        bright: (B,) int32, beams whose echo is brighter than white.
        measured: (N,) which beams see what was measured, with its drop-out, noise and intensity;
            ``None``: none does.
        several: those of them that see now one and now another surface.
    """

    beams: Beams
    poses: SensorPoses
    layers: StaticLayers
    directions: NDArray[np.float32]
    origin: NDArray[np.float32]
    report: tuple[NDArray[Any], ...]
    other: NDArray[np.int32]
    second: tuple[NDArray[Any], ...]
    amplitude: NDArray[np.float32]
    bright: NDArray[np.int32]
    measured: NDArray[np.bool_] | None = None
    several: SeveralRanges | None = None

    def drawn(self, draws: NDArray[np.uint16]) -> StaticView:
        """Return what is seen in one turn, in which chance chooses among surfaces.

        Args:
            draws: (N,) of the beams.
        """
        if self.several is None:
            return self
        layers, report = self.several.drawn(draws, self.layers, self.report)
        return replace(self, layers=layers, report=report)

    def as_measured(self, echoes: Echoes) -> None:
        """Give echoes of measured surfaces beside or before actors what was measured of them."""
        if self.measured is None:
            return
        row = np.flatnonzero(echoes.owner < 0)
        beam = np.repeat(echoes.beam, np.diff(echoes.start))[row]
        whole = np.abs(echoes.range_m[row] - self.layers.range_m[-1 - echoes.owner[row]]) < 1e-3
        row, beam = row[whole & self.measured[beam]], beam[whole & self.measured[beam]]
        level, _, sigma, intensity, _ = self.report
        echoes.level[row], echoes.sigma[row] = level[beam], sigma[beam]
        echoes.intensity[row] = intensity[beam]

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
        """Look at the world.

        Args:
            mounted: the sensor.
            beams: of it, in this turn.
            model: what it makes of echoes.
            world: the static world.
            path: where the sensor is.
            sweep: when its beams fire.
            dataset_SE3_site: to the frame of the points.
        """
        times = sweep.column_time_s[:1] if path.is_fixed else sweep.column_time_s
        poses = SensorPoses(*(np.ascontiguousarray(part) for part in path.true_poses(times)))
        # A sensor that stands still looks once and for all, so it can look well.
        kept = path.is_fixed and beams.rings is not None
        layers = world.layers(beams, sweep, poses, model.scatter, thorough=kept)
        measured = mounted.measured if kept else None
        several = None
        share = beams.footprint.share
        if measured is not None:
            several = measured.several(layers, model, mounted.effects)
            level = None
            if measured.fused:
                level = _strongest_levels(combined(layers, None, share, model, mounted.returns)[0])
            layers = measured.layers(layers, model, len(share), level)
        echoes, _ = combined(layers, None, share, model, mounted.returns)
        layer = -1 - echoes.owner
        first, has = np.maximum(echoes.first, 0), echoes.first >= 0
        if not len(layer):
            layer, has = np.zeros(1, np.int32), np.zeros(len(first), np.bool_)
        report = tuple(
            np.where(has, values[first] if len(values) else 0, np.zeros(1, values.dtype))
            for values in (
                *(echoes.level, echoes.range_m, echoes.sigma, echoes.intensity),
                echoes.amplitude,
            )
        )
        if measured is not None:
            report = measured.reported(report, has, mounted.effects, mounted.missing)
        amplitude = report[4]
        semantic = _classes(layers.semantic, layer[first], has)
        also = np.flatnonzero(echoes.second >= 0)
        other = np.full(len(first), -1, np.int32)
        other[also] = np.arange(len(also), dtype=np.int32)
        second = echoes.second[also]
        rotation, place = path.reported_poses(times)
        turned = np.asarray(dataset_SE3_site.rotation) @ rotation
        return cls(
            beams,
            poses,
            layers,
            _directions(beams, beams.believed, turned),
            np.ascontiguousarray(dataset_SE3_site.apply(place).T, np.float32),
            (*report[:4], semantic),
            other,
            (
                *(values[second] for values in (echoes.level, echoes.range_m)),
                *(values[second] for values in (echoes.sigma, echoes.intensity)),
                _classes(layers.semantic, layer[second], np.ones(len(second), np.bool_)),
            ),
            amplitude,
            np.flatnonzero(is_bright(amplitude)).astype(np.int32),
            None if measured is None else measured.known & has,
            several,
        )


def _directions(
    beams: Beams, directions: NDArray[np.float64], rotation: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return directions (3, N) of beams, turned with their columns' rotations (K or 1, 3, 3)."""
    if len(rotation) == 1:
        return np.ascontiguousarray((rotation[0] @ directions.T), np.float32)
    fans = directions.reshape(beams.channels, beams.columns, 3)
    turned = np.einsum("kij,ckj->ick", rotation, fans, optimize=True)
    return np.ascontiguousarray(turned.reshape(3, -1), np.float32)


def _strongest_levels(echoes: Echoes) -> NDArray[np.int32]:
    """Return the level (N,) below which a draw means a return of the first echo; 0: no echo."""
    level = np.zeros(len(echoes.first), np.int32)
    has = echoes.first >= 0
    level[has] = echoes.level[echoes.first[has]]
    return level


def _classes(
    semantic: NDArray[np.uint16], layer: NDArray[np.int32], has: NDArray[np.bool_]
) -> NDArray[np.uint16]:
    """Return the class of each layer; 0, unlabelled, where there is none."""
    if not len(semantic):
        return np.zeros(len(layer), np.uint16)
    return np.where(has, semantic[layer], np.uint16(0))
