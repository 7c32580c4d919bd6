"""Scene flow of points: where what each lies on is when the next frame looks at it.

The definition is that of Argoverse 2 (``av2.torch.data_loaders.scene_flow``: a point moves with the
body that it is on from its pose in one sweep to its pose in the next) and of Waymo (Jund et al.
2022, "Scalable Scene Flow From Point Clouds in the Real World": without the motion of who looks),
with one thing better: bodies do not stand in one pose for a whole turn. A point was measured at a
time of its own, and its body goes on from where it was then.
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
    """Return the flow (N, 3) of a frame's points, metres; ``nan`` where nobody knows it.

    Args:
        points: (N, 3) of the frame.
        semantic: (N,) their classes: what lies beside an actor, or is of no class, has no flow.
        instance: (N,) the track that each is on; 0: the static world, which stays.
        measured_s: (N,) when each was measured, seconds from the motion's start, true.
        paths: of the tracks.
        until_s: track -> when the next frame sees it, in the same seconds. Who is not in the next
            frame has no flow.
        site_SE3_now: takes points of the frame to the site.
        then_SE3_site: takes places of the site to the frame of the next one's points. With it, flow
            goes from where a point is in this frame's coordinates to where it will be in the next
            one's: with the motion of who looks (Argoverse 2). Without it, both are in this frame's:
            what stands has no flow.
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
    # site -> body when it was measured -> site when the next frame sees it.
    there = np.asarray(points[on], np.float64)
    away = site_SE3_now.apply(there) - was.translation
    inside = np.einsum("nji,nj->ni", was.rotation, away)
    target = np.einsum("nij,nj->ni", will.rotation, inside) + will.translation
    back = site_SE3_now.inverse() if then_SE3_site is None else then_SE3_site
    moved = back.apply(target) - there
    moved[(was.stretch < 0) | (was.stretch != will.stretch)] = np.nan
    flow[on] = moved
    return flow.astype(np.float32)
