"""What trainers read alike: the names of each part's frames, and boxes that teach something."""

from __future__ import annotations

from pathlib import Path

from urbantwin.exports.frames.source import FrameSource

__all__ = ["PARTS", "left_out", "write_splits"]

#: The parts that trainers ask for; both look for a list of each of the first two.
PARTS = ("train", "val", "test")


def write_splits(source: FrameSource, folder: Path) -> dict[str, tuple[str, ...]]:
    """Write ``ImageSets`` and return the names of each part: of two at least, maybe empty."""
    parts = {name: source.split.get(name, ()) for name in PARTS}
    if not parts["test"]:
        del parts["test"]
    (folder / "ImageSets").mkdir()
    for name, frames in parts.items():
        text = "".join(f"{one}\n" for one in frames)
        (folder / "ImageSets" / f"{name}.txt").write_text(text)
    return parts


def left_out(source: FrameSource, marked: str) -> list[str]:
    """Return what is said of boxes that a trainer does not learn, before anything is written.

    Args:
        source: the dataset.
        marked: what becomes of boxes that have points and do not count.
    """
    empty = ignored = 0
    for name in source.names:
        boxes = source.boxes_of(name)
        empty += int((boxes.num_points == 0).sum())
        ignored += int(((boxes.num_points > 0) & (boxes.ignored != "")).sum())
    told = []
    if empty:
        told.append(f"{empty} boxes without a point are left out: nothing can learn them")
    if ignored:
        told.append(f"{ignored} boxes that have points and do not count are {marked}")
    return told
