"""Labelling of a frame: a class and an instance for every point, a box for every actor."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import starmap
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose
from urbantwin.lidar.actor_path import PosedActor
from urbantwin.lidar.labels.borders import Bordering
from urbantwin.lidar.labels.frame import BoxLabel, LabelledFrame
from urbantwin.lidar.turn import Observation
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_id

__all__ = ["labelled"]

_Value = TypeVar("_Value", bound=np.generic)


def labelled(
    seen: Sequence[Observation],
    actors: Sequence[PosedActor],
    boxes: NDArray[np.float64],
    when_s: NDArray[np.float64],
    bordering: Bordering,
    dataset_SE3_site: Pose,
) -> LabelledFrame:
    """Fuse the sensors' returns and give every point and actor its labels.

    Args:
        seen: what was reported of each turn.
        actors: in the order in which returns number them.
        boxes: (A, 7) of the actors, dataset frame.
        when_s: (A,) when they stood there, seconds from the frame's time.
        bordering: how they lie to the borders of what the rig sees.
        dataset_SE3_site: to the frame of the points.
    """
    points = [one.points for one in seen]
    actor = _joined([one.actor for one in seen], np.int32)
    semantic = _joined([one.semantic for one in seen], np.uint16)
    instance = np.zeros(len(actor), np.uint16)
    hit = np.flatnonzero(actor >= 0)
    owner = actor[hit]
    classes = [semantic_id(BOX_SEMANTICS[one.actor_class]) for one in actors]
    semantic[hit] = np.array(classes, np.uint16)[owner]
    tracks = [one.track for one in actors]
    instance[hit] = np.array(tracks, np.uint16)[owner]
    count = np.bincount(owner, minlength=len(actors))
    alone = np.sum([one.alone for one in seen], axis=0, dtype=np.int64).reshape(-1)
    alone = alone if seen else np.zeros(len(actors), np.int64)
    velocity = np.array([one.velocity for one in actors]).reshape(-1, 3)
    velocity = velocity @ dataset_SE3_site.rotation.T
    sensor = np.array([one.sensor for one in seen], np.uint8)
    return LabelledFrame(
        _joined([one.xyzi for one in points], np.float32, (0, 4)),
        semantic,
        instance,
        np.repeat(sensor, [len(one.actor) for one in seen]),
        _joined([one.ring for one in points], np.uint16),
        _joined([one.column for one in points], np.uint16),
        _joined([one.time_s for one in points], np.float32),
        _joined([one.echo for one in seen], np.uint8),
        tuple(
            starmap(
                BoxLabel,
                zip(
                    tracks,
                    [one.actor_class for one in actors],
                    boxes,
                    count.tolist(),
                    alone.tolist(),
                    velocity,
                    when_s.tolist(),
                    bordering.truncation.tolist(),
                    bordering.whereabouts,
                    strict=True,
                ),
            )
        ),
    )


def _joined(
    parts: Sequence[NDArray[_Value]], kind: type[_Value], none: tuple[int, ...] = (0,)
) -> NDArray[_Value]:
    """Join the turns' arrays; that of one turn is taken as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(none, kind), *parts])
