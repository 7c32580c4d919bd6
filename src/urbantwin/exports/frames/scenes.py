"""Scenes: consecutive frames, split at gaps in time and at changes of the split's part."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.exports.frames.source import FrameSource

__all__ = ["LONGEST_GAP_S", "Scene", "scenes_of"]

#: Largest time between frames of a scene, seconds: the limit of nuScenes' devkit for velocities
#: (``NuScenes.box_velocity``).
LONGEST_GAP_S = 1.5


@dataclass(frozen=True)
class Scene:
    """Consecutive frames in one part of the split.

    Attributes:
        part: ``train``, ``val``, ``test``; ``None`` for a gap between parts.
        numbers: numbers of its frames in the dataset.
    """

    part: str | None
    numbers: range


def scenes_of(source: FrameSource, longest_gap_s: float = LONGEST_GAP_S) -> list[Scene]:
    """Return the scenes of a dataset in order of time; every frame is in one.

    Args:
        source: the dataset.
        longest_gap_s: largest time between frames of a scene, seconds.
    """
    parts = [source.part_of(name) for name in source.names]
    times = source.times_s
    cuts = [
        number
        for number in range(1, len(source))
        if parts[number] != parts[number - 1]
        or not 0 < times[number] - times[number - 1] <= longest_gap_s
    ]
    ends = [*cuts, len(source)]
    return [
        Scene(parts[first], range(first, end)) for first, end in zip([0, *cuts], ends, strict=True)
    ]
