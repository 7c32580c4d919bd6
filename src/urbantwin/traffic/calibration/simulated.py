"""A simulation as tracks, seen where the recording saw: to be measured as it was."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.assets import asset
from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.paths.abreast import with_parties
from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.traffic.sumo.driven_net import driven_net
from urbantwin.traffic.sumo.simulation import simulate
from urbantwin.twin import Twin

__all__ = ["parts_seen", "seen_area", "simulated_tracks"]

_STEP_S = 0.2
#: Beside the recorded paths so much is seen, metres; paths are taken so coarsely.
_BESIDE_M, _COARSE_M = 3.0, 0.5
#: Who was out of view for longer is somebody else when it comes back, seconds: so long are the gaps
#: that are closed in recorded tracks (``recorded/rejoined``). Fewer moments are no track.
_GONE_S, _FEWEST = 2.0, 3


def seen_area(tracks: list[SeenTrack]) -> shapely.Geometry:
    """Return where tracks were seen."""
    lines = [shapely.LineString(one.xy) for one in tracks if len(one.xy) > 1]
    return shapely.union_all(
        [line.simplify(_COARSE_M, preserve_topology=False).buffer(_BESIDE_M) for line in lines]
    )


def parts_seen(xy: NDArray[np.float64], area: shapely.Geometry, step_s: float) -> list[slice]:
    """Return which moments of a way (N, 2) are seen in an area: parts, where it was away between.

    Away is who is beyond everything that is seen. Who is beside the recorded paths for a moment, on
    a lane that nobody took, is followed.

    Args:
        xy: where somebody is, moment by moment.
        area: what is seen.
        step_s: time between two moments.
    """
    inside = np.flatnonzero(shapely.intersects_xy(area, *xy.T))
    away = np.cumsum(~shapely.intersects_xy(shapely.convex_hull(area), *xy.T))
    cuts = np.flatnonzero(np.diff(away[inside]) * step_s > _GONE_S) + 1
    return [
        slice(int(part[0]), int(part[-1]) + 1)
        for part in np.split(inside, cuts)
        if len(part) >= _FEWEST
    ]


def simulated_tracks(
    twin: Twin,
    asked: Mapping[str, Any],
    seconds: float,
    area: shapely.Geometry,
    *,
    scratch: Path,
    told: Callable[[float], None],
) -> list[SeenTrack]:
    """Return what of a simulation would have been seen in an area, track by track.

    Args:
        twin: on which.
        asked: ``traffic`` of the site.
        seconds: how long.
        area: what is seen.
        scratch: a folder for SUMO's files.
        told: called with the share that is done.
    """
    seed, warmup_s = int(asked["seed"]), float(asked["warmup_s"])
    demand = demand_of(twin, asked=asked, duration_s=seconds, seed=seed, scratch=scratch)
    steps = round(seconds / _STEP_S)
    net = driven_net(twin, asked, demand, seconds, scratch)
    found = simulate(
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
    found = with_parties(found, demand, twin.roads, _STEP_S)
    kept = np.flatnonzero((found.step >= 0) & (found.step < steps))
    order = kept[np.lexsort([found.step[kept], found.trip[kept]])]
    cuts = np.flatnonzero(np.diff(found.trip[order])) + 1
    shapely.prepare(area)
    tracks = []
    for rows in np.split(order, cuts) if len(order) else []:
        trip = demand.trips[int(found.trip[rows[0]])]
        mesh = asset(trip.asset)
        yaw = np.pi / 2 - np.radians(found.angle_deg[rows])
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        xy = found.front[rows] - ahead * mesh.length / 2
        size = np.array([mesh.length, mesh.width, mesh.height])
        for number, part in enumerate(parts_seen(xy, area, _STEP_S)):
            times = np.asarray(found.step[rows][part] * _STEP_S, np.float64)
            nothing = np.full(len(times), np.nan)
            name = f"{found.trip[rows[0]]}" + (f" again {number}" if number else "")
            track = RecordedTrack(name, trip.actor_class, times, xy[part], yaw[part], nothing, size)
            tracks.append(SeenTrack(track, times, xy[part], yaw[part], found.speed[rows][part]))
    return tracks
