"""What OpenPCDet and MMDetection3D read alike: names of frames, lines of labels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from urbantwin.exports.frames.source import FrameSource

__all__ = ["PARTS", "left_out", "write_splits"]

#: The parts that trainers ask for; both look for a list of each of the first two.
PARTS = ("train", "val", "test")


def write_splits(source: FrameSource, folder: Path) -> dict[str, Sequence[str]]:
    """Write ``ImageSets`` and return the names of each part: of two at least, maybe empty."""
    parts = {name: source.split.get(name, ()) for name in PARTS}
    if not parts["test"]:
        del parts["test"]
    (folder / "ImageSets").mkdir()
    for name, frames in parts.items():
        text = "".join(f"{one}\n" for one in frames)
        (folder / "ImageSets" / f"{name}.txt").write_text(text)
    return parts


def left_out(without_points: int, marked: int, mark: str) -> list[str]:
    """Return what a person should be told of boxes that a trainer does not learn."""
    told = []
    if without_points:
        told.append(f"left out: {without_points} boxes without a point, which nothing can learn")
    if marked:
        told.append(f"{marked} boxes that have points and do not count are {mark}")
    return told
