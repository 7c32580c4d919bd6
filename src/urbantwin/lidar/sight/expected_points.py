"""Expected number of points of a sensor on the static world and on actors.

A beam has its footprint, passes panes of glass, and returns with the probability of the sensor's
model (`lidar.echoes`): the distribution from which `urbantwin record` draws. Sensors do not
influence each other, so the points of a rig are the sum over its sensors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.casting.cast import cast_actors
from urbantwin.lidar.casting.tracer import Firing, RayTracer, SensorPoses
from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.lidar.echoes import Alone, Echoes, combined, static_echoes
from urbantwin.lidar.returns import LEVELS, ReturnModel
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.shapes import PresentActors
from urbantwin.lidar.static_world import StaticLayers, World
from urbantwin.lidar.timing import Sweep
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id

__all__ = ["NOBODY", "ActorPoints", "ExpectedPoints", "StaticPoints", "Turn", "one_pose"]

#: Blocker of an actor without occlusion.
NOBODY = -(1 << 30)


class StaticPoints(NamedTuple):
    """Echoes of the static world that a turn may report.

    Attributes:
        beam: (K,) beam of each.
        place: (K, 3) float64, its position, site frame, metres.
        range_m: (K,) float32.
        chance: (K,) float64, 0..1, probability that it is reported.
        is_ground: (K,) whether it is on the ground.
    """

    beam: NDArray[np.int32]
    place: NDArray[np.float64]
    range_m: NDArray[np.float32]
    chance: NDArray[np.float64]
    is_ground: NDArray[np.bool_]


class ActorPoints(NamedTuple):
    """Expected points of a turn on A actors.

    Attributes:
        points: (A,) float64, expected points.
        alone: (A,) float64, expected points without occlusion.
        blocker: (A,) int64, the object that hides most: index of an actor, or -1 less a semantic
            class; `NOBODY` for none.
        taken: (A,) float64, number of points that it hides.
    """

    points: NDArray[np.float64]
    alone: NDArray[np.float64]
    blocker: NDArray[np.int64]
    taken: NDArray[np.float64]


class ExpectedPoints:
    """Casts sensors at a static world, which is prepared once.

    Args:
        mesh: the static world, site frame.
        surface: materials of the ground at finer resolution than the mesh.
        near: (3,) a position near the sensors, site frame, metres.
    """

    def __init__(
        self, mesh: LabelledMesh, surface: SurfaceMaterials | None, near: NDArray[np.float64]
    ) -> None:
        self._tracer = tracer_on()
        self._world = World(mesh, near, surface, self._tracer)

    def turn(
        self, mounted: MountedSensor, model: ReturnModel, beams: Beams, poses: SensorPoses
    ) -> Turn:
        """Cast a turn at the static world.

        Args:
            mounted: the sensor.
            model: its return model.
            beams: beams of the turn.
            poses: one pose of the sensor, site frame.
        """
        sweep = Sweep.snapshot(beams.columns, beams.channels)
        static = self._world.layers(beams, sweep, poses, model, thorough=True)
        return Turn(mounted, model, beams, poses, static, self._tracer)


def one_pose(site_SE3_sensor: Pose) -> SensorPoses:
    """Return the pose of a fixed sensor in the form of ray casting."""
    rotation, translation = site_SE3_sensor.rotation, site_SE3_sensor.translation
    return SensorPoses(np.array(rotation[None], order="C"), np.array(translation[None]))


@dataclass(frozen=True, eq=False)
class Turn:
    """N beams of a sensor, and their static layers.

    Attributes:
        mounted: the sensor.
        model: its return model.
        beams: beams of the turn.
        poses: its pose, site frame.
        static: static layers along the beams.
        tracer: ray tracer.
    """

    mounted: MountedSensor
    model: ReturnModel
    beams: Beams
    poses: SensorPoses
    static: StaticLayers
    tracer: RayTracer

    @cached_property
    def aims(self) -> NDArray[np.float64]:
        """Unit vectors (N, 3) of the beams, site frame."""
        return np.asarray(self.beams.directions @ self.poses.rotation[0].T)

    @cached_property
    def points(self) -> StaticPoints:
        """Returns of the static world without actors."""
        share, returns = self.beams.footprint.share, self.mounted.returns
        echoes = static_echoes(self.static, share, self.model, returns)
        echo, beam, chance = _reported(echoes, dual=returns == "dual")
        range_m = echoes.range_m[echo]
        place = self.poses.translation[0] + self.aims[beam] * range_m[:, None]
        ground = [semantic_id(name) for name in GROUND_CLASSES]
        is_ground = np.isin(self.static.semantic[-1 - echoes.owner[echo]], ground)
        return StaticPoints(beam, place, range_m, chance, is_ground)

    def panes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the range of the first pane (N,) of each beam, metres, and its transmission, 0..1.

        ``inf`` and 1 without one.
        """
        layer = np.flatnonzero(self.static.through > 0)
        layer = layer[np.argsort(-self.static.range_m[layer], kind="stable")]
        beam = self.static.beam[layer]
        range_m, passes = np.full(len(self.aims), np.inf), np.ones(len(self.aims))
        # The nearest pane is written last.
        range_m[beam], passes[beam] = self.static.range_m[layer], self.static.through[layer]
        return range_m, passes

    def on_actors(self, actors: PresentActors, sweep: Sweep) -> ActorPoints | None:
        """Return the expected points on actors; ``None`` if no beam touches any.

        Args:
            actors: A actors.
            sweep: firing times.
        """
        met = cast_actors(
            self.tracer,
            self.beams,
            Firing.of(self.beams, sweep, self.poses),
            actors,
            self.mounted.sensor.assumed_range_max_m,
            glass=self.mounted.effects.glass,
        )
        if not len(met.ray):
            return None
        returns, count = self.mounted.returns, len(actors.shape)
        share = self.beams.footprint.share
        echoes, lone = combined(self.static, actors, met, share, self.model, returns)
        echo, _, chance = _reported(echoes, dual=returns == "dual")
        own = (echoes.owner[echo] >= 0) & (echoes.owner[echo] < BESIDE)
        points = np.bincount(echoes.owner[echo[own]], chance[own], minlength=count)
        alone = np.bincount(lone.actor, lone.level / LEVELS, minlength=count)
        blocker, taken = _blockers(echoes, lone, self.static, count)
        working = np.float64(1.0 - self.mounted.missing)
        return ActorPoints(
            np.asarray(working * points), np.asarray(working * alone), blocker, working * taken
        )


def _reported(
    echoes: Echoes, *, dual: bool
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
    """Return the echoes (K,) that may be reported, the beam of each, and its probability.

    A second echo is reported besides the first (``dual``), or if the first was missed.
    """
    chance = echoes.level / LEVELS
    first = np.flatnonzero(echoes.first >= 0)
    second = np.flatnonzero(echoes.second >= 0)
    missed = 1.0 - np.where(echoes.first >= 0, chance[np.maximum(echoes.first, 0)], 0.0)
    echo = np.concatenate([echoes.first[first], echoes.second[second]])
    beam = echoes.beam[np.concatenate([first, second])]
    weight = np.ones(len(second)) if dual else missed[second]
    return echo, beam, chance[echo] * np.concatenate([np.ones(len(first)), weight])


def _blockers(
    echoes: Echoes, alone: Alone, static: StaticLayers, count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return what hides most points of each actor (A,), as in `ActorPoints`."""
    blocker, most = np.full(count, NOBODY, np.int64), np.zeros(count)
    place = echoes.place[alone.beam]
    first = np.where(place >= 0, echoes.first[np.maximum(place, 0)], -1)
    owner = echoes.owner[np.maximum(first, 0)].astype(np.int64)
    lost = (first >= 0) & ((owner < 0) | (owner % BESIDE != alone.actor))
    owner, actor = owner[lost], alone.actor[lost].astype(np.int64)
    semantic = static.semantic[-1 - np.minimum(owner, -1)].astype(np.int64)
    code = np.where(owner >= 0, owner % BESIDE, -1 - semantic)
    pairs, which = np.unique(np.stack([actor, code]), axis=1, return_inverse=True)
    taken = np.bincount(which.ravel(), alone.level[lost] / LEVELS, minlength=pairs.shape[1])
    # The largest is written last; of equals the first code.
    order = np.lexsort((-np.arange(len(taken)), taken))
    order = order[taken[order] > 0]
    blocker[pairs[0, order]], most[pairs[0, order]] = pairs[1, order], taken[order]
    return blocker, most
