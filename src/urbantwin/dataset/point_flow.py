"""Scene flow of points: motion of the surface under each point until the next frame sees it.

The definition follows Argoverse 2 (``av2.torch.data_loaders.scene_flow``: a point moves with its
body from its pose in one sweep to its pose in the next) and Waymo (Jund et al. 2022, "Scalable
Scene Flow From Point Clouds in the Real World": without ego motion), but bodies are not assumed
static during a turn: the body's pose is taken at the time of each point.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.track_paths import TrackPaths
from urbantwin.geometry import Pose
from urbantwin.taxonomy import semantic_id

__all__ = ["flow_of"]


def flow_of(
    points: NDArray[np.floating],
    semantic: NDArray[np.uint16],
    instance: NDArray[np.uint16],
    measured_s: NDArray[np.float64],
    paths: TrackPaths,
    until_s: Mapping[int, float],
    site_SE3_now: Pose,
    then_SE3_site: Pose | None = None,
) -> NDArray[np.float32]:
    """Return the flow (N, 3) of a frame's points, metres; ``nan`` where unknown.

    Args:
        points: (N, 3) points of the frame.
        semantic: (N,) classes: points beside an actor, or without a class, have no flow.
        instance: (N,) tracks; 0: the static world.
        measured_s: (N,) time of each point, seconds from the motion's start, true.
        paths: paths of the tracks.
        until_s: track -> time at which the next frame sees it, same clock. Tracks that are not in
            the next frame have no flow.
        site_SE3_now: pose of the frame of the points.
        then_SE3_site: from the site to the next frame. If given, the flow is from a point's
            coordinates in this frame to those in the next one, with ego motion (Argoverse 2).
            Otherwise both are in this frame's: the static world has no flow.
    """
    flow = np.zeros((len(points), 3))
    flow[np.isin(semantic, (semantic_id("unlabelled"), semantic_id("outlier")))] = np.nan
    if then_SE3_site is not None:
        then_SE3_now = then_SE3_site @ site_SE3_now
        flow += then_SE3_now.apply(points) - points
    on = np.flatnonzero(instance)
    tracks, which = np.unique(instance[on], return_inverse=True)
    seen_s = np.array([until_s.get(track, np.nan) for track in tracks.tolist()])[which]
    stays = np.isfinite(seen_s)
    flow[on[~stays]] = np.nan
    on, seen_s = on[stays], seen_s[stays]
    was, will = (paths.at(instance[on], times) for times in (measured_s[on], seen_s))
    # From the site to the body when measured, and to the site when the next frame sees it.
    start = np.asarray(points[on], np.float64)
    from_body = site_SE3_now.apply(start) - was.translation
    inside = np.einsum("nji,nj->ni", was.rotation, from_body)
    target = np.einsum("nij,nj->ni", will.rotation, inside) + will.translation
    back = site_SE3_now.inverse() if then_SE3_site is None else then_SE3_site
    moved = back.apply(target) - start
    moved[(was.stretch < 0) | (was.stretch != will.stretch)] = np.nan
    flow[on] = moved
    return flow.astype(np.float32)
