"""A plain folder of clouds, or one cloud: npy, bin, pcd, ply, las, laz, mixed as they come."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import FORMATS, is_cloud, read_fields
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.box_list import BOX_LIST, frame_number, read_box_list
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["clouds_in", "is_plain", "open_plain"]


def clouds_in(folder: Path, *suffixes: str) -> list[Path]:
    """Return the clouds of a folder as people count: ``frame_200`` before ``frame_1000``.

    Args:
        folder: empty for none if it is not there.
        suffixes: of names, in lower case; all formats where none is given.
    """
    if not folder.is_dir():
        return []
    wanted = suffixes or FORMATS
    found = (p for p in folder.iterdir() if is_cloud(p) and p.name.lower().endswith(wanted))
    return sorted(found, key=counting_order)


def is_plain(path: Path) -> bool:
    """Return whether there is at least one cloud."""
    return is_cloud(path) or bool(clouds_in(path))


def open_plain(path: Path, columns: int | None) -> Recording:
    """Open a folder of clouds, or one cloud; labelled where a list of boxes is beside it.

    Raises:
        InputError: there is no cloud, or the list is not right.
    """
    files = [path] if path.is_file() else clouds_in(path)
    if not files:
        raise InputError("holds no clouds", file=path, expected=f"{', '.join(FORMATS)} files")
    kinds = Counter(file.suffix.lower()[1:] for file in files)
    listed = files[0].parent / BOX_LIST
    boxes = read_box_list(listed) if listed.is_file() else {}
    mixed = " and ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))

    def read(index: int) -> Frame:
        file = files[index]
        found = boxes.get(frame_number(file.name))
        return frame_of(file, read_fields(file, columns), name=file.name, boxes=found)

    return Recording(
        path=path,
        layout="plain",
        names=tuple(file.name for file in files),
        read_frame=read,
        notes=(f"Holds files of several formats: {mixed}.",) if len(kinds) > 1 else (),
    )
