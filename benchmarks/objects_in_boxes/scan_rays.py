"""Bodies seen along given rays, as the modelled sensor would report them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from objects_in_boxes.bodies import PlacedBody
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar.actor_path import Paths, PosedActor
from urbantwin.lidar.beams import Beams, Footprint
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.casting.cast import cast_actors
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_path import FixedPath
from urbantwin.lidar.shapes import PresentActors, ShapeTable
from urbantwin.lidar.standing import standing_at
from urbantwin.lidar.static_view import StaticView
from urbantwin.lidar.static_world import StaticLayers, World
from urbantwin.lidar.timing import Sweep
from urbantwin.lidar.turn import Turn, observe
from urbantwin.site.rig import Effects
from urbantwin.taxonomy import material_id, materials, semantic_id

__all__ = ["SeenBodies", "scan_rays"]

#: Rays are put in so many rows; a row's number fits 16 bits.
_ROWS = 64
#: What stands behind objects.
_WALL = "plaster"
#: The frame's points stand already where they are at its time; stray light needs whole turns.
_EFFECTS = Effects(rolling_shutter=False, blooming=False, sun=False, weather=False)


@dataclass(frozen=True, eq=False)
class SeenBodies:
    """What R rays met and what came back.

    Attributes:
        body: (R,) the body whose surface is met first, -1 for none.
        meets_m: (R,) the range of that surface; inf where there is none.
        is_pane: (R,) whether it is a pane.
        is_open: (R,) whether the ray leaves the body again, through panes alone.
        range_m: (R,) what the sensor reports; inf where it reports nothing.
        intensity: (R,) 0 to 1.
        reported: (R,) the body that this is of; -1 for none.
    """

    body: NDArray[np.int64]
    meets_m: NDArray[np.float64]
    is_pane: NDArray[np.bool_]
    is_open: NDArray[np.bool_]
    range_m: NDArray[np.float64]
    intensity: NDArray[np.float64]
    reported: NDArray[np.int64]


def scan_rays(
    sensor: Sensor,
    origin: NDArray[np.float64],
    direction: NDArray[np.float64],
    bodies: list[PlacedBody],
    ground: LabelledMesh,
    behind_m: NDArray[np.float64],
    seed: int,
) -> SeenBodies:
    """Scan bodies on the ground along rays.

    Args:
        sensor: what the rays are of.
        origin: (3,) where they leave, frame of the bodies' boxes.
        direction: (R, 3) unit vectors.
        bodies: what stands there.
        ground: below and behind them.
        behind_m: (R,) range of what each ray met in the frame that is no object, and stands there
            in place of the ground: a part of a beam's light goes there. inf where nothing is known.
        seed: of all random numbers.
    """
    count = len(direction)
    columns = -(-count // _ROWS)
    # What fills the last row looks straight up.
    aims = np.zeros((_ROWS * columns, 3))
    aims[:, 2] = 1.0
    aims[:count] = direction
    mounted = MountedSensor("real", sensor, columns, Pose.from_ypr(origin), _EFFECTS)
    model = ReturnModel(mounted)
    beams = Beams(aims, columns, _ROWS, Footprint.of(sensor), aims, 0.0, None)
    sweep, frame = Sweep.snapshot(columns, _ROWS), Pose.from_ypr(np.zeros(3))
    tracer = tracer_on()
    world = World(ground, origin, None, tracer)
    path = FixedPath(mounted.site_SE3_sensor)
    view = StaticView.of(mounted, beams, model, world, path, sweep, frame)
    view = replace(
        view, layers=_with_behind(view.layers, behind_m, model, len(beams.footprint.share))
    )
    turn = Turn(0, mounted, model, view, sweep, np.zeros(0, np.bool_), known=None)
    table = ShapeTable(lambda name, _: bodies[int(name)].mesh)
    actors = [
        PosedActor(n + 1, "car", str(n), 0, body.pose, np.zeros(3)) for n, body in enumerate(bodies)
    ]
    shape = np.array([table.number(one.asset, 0) for one in actors], np.int64)
    present = PresentActors(table.arrays, shape, Paths.of([one.way for one in actors]))
    met = cast_actors(tracer, beams, turn.firing, present, sensor.assumed_range_max_m, glass=True)
    standing = standing_at(np.zeros(len(actors)), present, frame)
    seen = observe(turn, met, present, standing, seed)

    clear = np.array([one.transmission > 0 for one in materials().values()])
    pane = clear[present.material(met.actor, met.face)]
    axis = (met.mask & 1).astype(np.bool_)
    order = np.flatnonzero(axis)
    order = order[np.lexsort([met.range_m[order], met.ray[order]])]
    ray, first = np.unique(met.ray[order], return_index=True)
    body = np.full(len(aims), -1, np.int64)
    meets, is_pane = np.full(len(aims), np.inf), np.zeros(len(aims), np.bool_)
    body[ray], meets[ray] = met.actor[order[first]], met.range_m[order[first]]
    is_pane[ray] = pane[order[first]]
    opaque = np.zeros(len(aims), np.bool_)
    opaque[met.ray[order[~pane[order]]]] = True
    beam = seen.points.ring.astype(np.int64) * columns + seen.points.column
    range_m, intensity = np.full(len(aims), np.inf), np.zeros(len(aims))
    reported = np.full(len(aims), -1, np.int64)
    # Of two echoes the first is kept.
    beam, once = np.unique(beam, return_index=True)
    range_m[beam] = np.linalg.norm(seen.points.xyzi[once, :3] - origin, axis=1)
    intensity[beam] = seen.points.xyzi[once, 3]
    reported[beam] = seen.actor[once]
    return SeenBodies(
        body[:count],
        meets[:count],
        is_pane[:count],
        (is_pane & ~opaque)[:count],
        range_m[:count],
        intensity[:count],
        reported[:count],
    )


def _with_behind(
    layers: StaticLayers, behind_m: NDArray[np.float64], model: ReturnModel, samples: int
) -> StaticLayers:
    """Return layers of N beams, those of the first R replaced by what stands behind at ranges (R,).

    What it is made of a frame does not say: it is a wall that is faced.
    """
    known = np.zeros(len(layers.start) - 1, np.bool_)
    known[: len(behind_m)] = np.isfinite(behind_m)
    new = np.flatnonzero(known)
    wall, facing = np.full(len(new), material_id(_WALL)), np.ones(len(new), np.float32)
    return layers.filled(
        ~known[layers.beam],
        new,
        behind_m[new].astype(np.float32),
        model.scatter.backscatter(wall, facing),
        np.full(len(new), semantic_id("building"), np.uint16),
        samples,
    )
