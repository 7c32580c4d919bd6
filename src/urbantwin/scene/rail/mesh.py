"""Rails, sleepers, ballast and platforms as triangles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.roads.building_ground import building_ground
from urbantwin.scene.placement import not_imported
from urbantwin.scene.rail.platform import add_platforms
from urbantwin.scene.rail.track import HEAD_M, Track, tracks_of
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box, sweep
from urbantwin.site.extract import OsmFeature

__all__ = ["rail_mesh"]

#: How far down rails are drawn; on ballast they stand 0.17 m high on sleepers (EN 13674), metres.
DEPTH_M, RAIL_M = 0.2, 0.17
#: Concrete sleepers: 0.6 m apart, 2.6 m long on standard gauge, metres.
SLEEPER_STEP_M, SLEEPER_M = 0.6, (0.26, 0.21)
#: The bed is wider than sleepers by this to both sides, its slopes 1 in 1.5.
SHOULDER_M, SLOPE = 0.4, 1.5
MOST_SLEEPERS = 4000
BURIED_M = 0.3
#: Track with its rails lower than this above the ground lies in the pavement, metres.
EMBEDDED_M = 0.25


def rail_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    ride_height: GroundHeight | None = None,
    without: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build tracks and platforms.

    Rails are class ``other-ground``, as SemanticKITTI has it, and so is ballast.

    Args:
        features: the map's features, site frame.
        region: tracks end at its border.
        ground_height: heights of the ground.
        carriageway: where tracks lie in the pavement and no platform is.
        ride_height: heights of the ground and of decks that carry rails.
        without: where imported geometry has them.

    Returns:
        The mesh, ``part`` 1, 2, ... per track or platform, and counts of what was built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    paved = shapely.union_all(
        [f.geometry for f in features
         if f.tags.get("highway") == "pedestrian" and f.geometry.geom_type.endswith("Polygon")]
    )  # fmt: skip
    mine = [f for f in features if "railway" in f.tags or "public_transport" in f.tags
            or f.tags.get("highway") == "platform"]  # fmt: skip
    mine = not_imported(mine, without)
    tracks = tracks_of(mine, region, ride_height or ground_height, carriageway, paved)
    sleepers = 0
    for track in tracks:
        part = assembly.new_part()
        for side in (1.0, -1.0):
            assembly.add(_rail(track, side), "other-ground", "metal-bare", part)
        for run in _ballasted(track):
            sleepers += _add_bed(assembly, track, run, part, sleepers < MOST_SLEEPERS)
        notes["tracks, m"] += round(
            float(np.linalg.norm(np.diff(track.path, axis=0), axis=1).sum())
        )
    notes["sleepers"] = sleepers
    notes["platforms"] = add_platforms(
        assembly, mine, region, ground_height, carriageway, building_ground(features)
    )
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _rail(track: Track, side: float) -> Solid:
    """Return one rail: its inner edge is half the gauge from the middle."""
    inner, outer = side * track.gauge / 2, side * (track.gauge / 2 + HEAD_M)
    left, right = max(inner, outer), min(inner, outer)
    profile = np.array([(left, -DEPTH_M), (right, -DEPTH_M), (right, 0.0), (left, 0.0)])
    return sweep(track.path, profile)


def _ballasted(track: Track) -> list[NDArray[np.int64]]:
    """Return the runs of points of a track that lie on ballast."""
    high = track.lift > EMBEDDED_M
    runs = np.split(np.arange(len(high)), np.flatnonzero(np.diff(high)) + 1)
    return [run for run in runs if len(run) > 1 and high[run[0]]]


def _add_bed(
    assembly: Assembly, track: Track, run: NDArray[np.int64], part: int, with_sleepers: bool
) -> int:
    """Add the ballast under a run of a track and its sleepers; return how many."""
    path, lift = track.path[run], track.lift[run]
    long = track.gauge + 1.165
    half = long / 2 + SHOULDER_M
    crest = -RAIL_M - 0.05
    low = -lift - BURIED_M
    foot = half + SLOPE * (crest - low)
    count = len(run)
    profile = np.empty((count, 4, 2))
    profile[:, 0] = np.column_stack([foot, low])
    profile[:, 1] = np.column_stack([-foot, low])
    profile[:, 2] = [-half, crest]
    profile[:, 3] = [half, crest]
    assembly.add(sweep(path, profile), "other-ground", "gravel", part)
    if not with_sleepers:
        return 0
    step = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    at = np.arange(SLEEPER_STEP_M / 2, along[-1], SLEEPER_STEP_M)
    if not len(at):
        return 0
    piece = np.clip(np.searchsorted(along, at, side="right") - 1, 0, count - 2)
    way = np.diff(path, axis=0)[piece]
    centre = np.column_stack([np.interp(at, along, path[:, k]) for k in range(3)])
    centre[:, 2] -= RAIL_M + SLEEPER_M[1] / 2
    size = np.full((len(at), 3), [SLEEPER_M[0], long, SLEEPER_M[1]])
    ties = box(centre, size, np.arctan2(way[:, 1], way[:, 0]))
    assembly.add(ties, "other-ground", "concrete", part)
    return len(at)
