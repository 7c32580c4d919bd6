"""Common parts of trainer formats: lists of frames per part, configs, and omitted boxes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.exports.frames.learned_classes import LearnedClasses, learned_classes
from urbantwin.exports.frames.source import FrameSource

__all__ = ["PARTS", "left_out", "write_configs", "write_splits"]

#: Parts used by trainers; both trainers require a list of each of the first two.
PARTS = ("train", "val", "test")


def write_splits(source: FrameSource, folder: Path) -> dict[str, tuple[str, ...]]:
    """Write ``ImageSets``, and return the frame names of each part; at least two parts."""
    parts = {name: source.splits.get(name, ()) for name in PARTS}
    if not parts["test"]:
        del parts["test"]
    (folder / "ImageSets").mkdir()
    for name, frames in parts.items():
        text = "".join(f"{one}\n" for one in frames)
        (folder / "ImageSets" / f"{name}.txt").write_text(text, encoding="utf-8")
    return parts


def write_configs(
    source: FrameSource, folder: Path, configs: Mapping[str, Callable[[LearnedClasses], str]]
) -> Sequence[str]:
    """Write training configs, by file name; return notes for the user."""
    try:
        learned = learned_classes(source.folder)
    except InputError as error:  # the dataset is still useful for evaluation, or with others
        return [f"no config: {error.problem}"]
    for name, text in configs.items():
        (folder / name).write_text(text(learned), encoding="utf-8")
    return learned.notes


def left_out(source: FrameSource, marked: str) -> list[str]:
    """Return notes on boxes that a trainer does not learn.

    Args:
        source: the dataset.
        marked: treatment of boxes with points that do not count.
    """
    empty = ignored = 0
    for name in source.names:
        boxes = source.objects.of_frame(name)
        empty += int((boxes.num_points == 0).sum())
        ignored += int(((boxes.num_points > 0) & (boxes.ignored != "")).sum())
    told = []
    if empty:
        told.append(f"{empty} boxes without a point are left out: nothing can learn them")
    if ignored:
        told.append(f"{ignored} boxes that have points and do not count are {marked}")
    return told
