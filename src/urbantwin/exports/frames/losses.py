"""Losses of a dataset in an export format, reported before anything is written."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection

from urbantwin.exports.frames.source import FrameSource
from urbantwin.taxonomy import classes_in, semantic_classes

__all__ = ["FIELDS", "losses_of"]

#: Fields of a dataset, as named in ``DatasetFormat.holds``: kind of data, and description.
FIELDS: dict[str, tuple[str, str]] = {
    "intensity": ("points", "intensity"),
    "ring": ("points", "ring"),
    "column": ("points", "column"),
    "time": ("points", "time"),
    "echo": ("points", "echo"),
    "sensor": ("points", "sensor"),
    "semantic": ("points", "semantic class"),
    "instance": ("points", "instance"),
    "boxes": ("boxes", "the boxes themselves"),
    "track": ("boxes", "track"),
    "velocity": ("boxes", "velocity"),
    "num_points": ("boxes", "number of points"),
    "occlusion": ("boxes", "occlusion"),
    "truncation": ("boxes", "truncation"),
    "ignored": ("boxes", "why one does not count"),
    "observed": ("boxes", "when the actor stood there"),
    "parked": ("boxes", "who is parked"),
    "towed": ("boxes", "who is towed"),
    "frame_time": ("frames", "time"),
    "frame_pose": ("frames", "pose in the site"),
    "sensor_poses": ("frames", "poses of the sensors"),
    "split": ("frames", "which train and which judge"),
}


def losses_of(source: FrameSource, format_name: str, holds: Collection[str]) -> list[str]:
    """Return the losses of a dataset in a format, a sentence each.

    Args:
        source: the dataset.
        format_name: name of the format, for its classes.
        holds: the `FIELDS` that it can hold.

    Returns:
        Sentences; empty without losses.
    """
    held = set(holds)
    missing = [name for name in FIELDS if name not in held]
    if "boxes" in missing:
        missing = [name for name in missing if name == "boxes" or FIELDS[name][0] != "boxes"]
    told = []
    by_kind: dict[str, list[str]] = defaultdict(list)
    for name in missing:
        kind, what = FIELDS[name]
        by_kind[kind].append(what)
    if by_kind:
        lost = "; ".join(f"of {kind}: {', '.join(names)}" for kind, names in by_kind.items())
        told.append(f"{format_name} cannot hold {lost}")
    if "boxes" in held:
        told += _of_classes(classes_in(format_name), source.labelled_classes, format_name, "boxes")
    if "semantic" in held:
        counts = source.manifest["counts"]["points_by_class"]
        names = [name for name in semantic_classes() if counts.get(name)]
        told += _of_classes(classes_in(format_name, "point"), names, format_name, "points")
    return told


def _of_classes(
    theirs: dict[str, str | None], ours: Collection[str], format_name: str, of: str
) -> list[str]:
    """Return notes on merged and omitted classes; empty for formats with free class names."""
    if not theirs:
        return []
    merged: dict[str, list[str]] = defaultdict(list)
    left = []
    for name in ours:
        there = theirs.get(name)
        if there is None:
            left.append(name)
        else:
            merged[there].append(name)
    told = [
        f"{' and '.join(names)} are merged: {of} are {there} in {format_name}"
        for there, names in merged.items()
        if len(names) > 1
    ]
    if left:
        told.append(f"{format_name} has no class for {of} of {', '.join(left)}: they are left out")
    return told
