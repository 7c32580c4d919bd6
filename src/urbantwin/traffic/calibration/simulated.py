"""A simulation as tracks within the observed area, for the same measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from urbantwin.traffic.assets import asset
from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.paths.abreast import with_parties
from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.traffic.sumo.driven_net import driven_net
from urbantwin.traffic.sumo.simulation import simulate
from urbantwin.twin import Twin

__all__ = ["seen_area", "simulated_tracks"]

_STEP_S = 0.2
#: Width beside the recorded paths that counts as observed, and tolerance of their simplification,
#: metres.
_BESIDE_M, _SIMPLIFICATION_M = 3.0, 0.5


def seen_area(tracks: list[SeenTrack]) -> shapely.Geometry:
    """Return the area around recorded tracks."""
    lines = [shapely.LineString(seen.xy) for seen in tracks if len(seen.xy) > 1]
    return shapely.union_all(
        [
            line.simplify(_SIMPLIFICATION_M, preserve_topology=False).buffer(_BESIDE_M)
            for line in lines
        ]
    )


def simulated_tracks(
    twin: Twin,
    asked: Mapping[str, Any],
    seconds: float,
    area: shapely.Geometry,
    *,
    scratch: Path,
    told: Callable[[float], None],
) -> list[SeenTrack]:
    """Return the tracks of a simulation within an area.

    Args:
        twin: the twin.
        asked: ``traffic`` of the site.
        seconds: duration.
        area: observed area.
        scratch: folder for SUMO's files.
        told: called with the fraction done.
    """
    seed, warmup_s = int(asked["seed"]), float(asked["warmup_s"])
    demand = demand_of(twin, asked=asked, duration_s=seconds, seed=seed)
    steps = round(seconds / _STEP_S)
    net = driven_net(twin, asked, demand, seconds, scratch)
    simulated = simulate(
        net,
        demand,
        asset,
        warmup_s=warmup_s,
        steps=steps,
        step_s=_STEP_S,
        seed=seed,
        scratch=scratch,
        progress=lambda share, _: told(share),
    )
    simulated = with_parties(simulated, demand, twin.roads, _STEP_S)
    in_span = np.flatnonzero((simulated.step >= 0) & (simulated.step < steps))
    order = in_span[np.lexsort([simulated.step[in_span], simulated.trip[in_span]])]
    cuts = np.flatnonzero(np.diff(simulated.trip[order])) + 1
    shapely.prepare(area)
    tracks = []
    for rows in np.split(order, cuts) if len(order) else []:
        trip = demand.trips[int(simulated.trip[rows[0]])]
        mesh = asset(trip.asset)
        yaw = np.pi / 2 - np.radians(simulated.angle_deg[rows])
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        xy = simulated.front[rows] - ahead * mesh.length / 2
        inside = np.flatnonzero(shapely.intersects_xy(area, *xy.T))
        if len(inside) < 3:
            continue
        part = slice(int(inside[0]), int(inside[-1]) + 1)
        times = np.asarray(simulated.step[rows][part] * _STEP_S, np.float64)
        size = np.array([mesh.length, mesh.width, mesh.height])
        nothing = np.full(len(times), np.nan)
        name = str(simulated.trip[rows[0]])
        track = RecordedTrack(name, trip.actor_class, times, xy[part], yaw[part], nothing, size)
        tracks.append(SeenTrack(track, times, xy[part], yaw[part], simulated.speed[rows][part]))
    return tracks
