"""Layouts of recordings, and their detection from a folder's or file's content."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.fidelity.readers.argoverse import is_argoverse, open_argoverse
from urbantwin.fidelity.readers.bag import is_mcap, is_rosbag, open_bag
from urbantwin.fidelity.readers.captures import CAPTURES, is_capture_of, open_capture
from urbantwin.fidelity.readers.folder import FolderDataset, is_plain, open_plain
from urbantwin.fidelity.readers.kitti import KITTI, KITTI_TRACKING, SEMANTIC_KITTI
from urbantwin.fidelity.readers.kitti_raw import KITTI_RAW
from urbantwin.fidelity.readers.nuscenes import is_nuscenes, open_nuscenes
from urbantwin.fidelity.readers.opencood import OPENCOOD
from urbantwin.fidelity.readers.openlabel import TUMTRAF
from urbantwin.fidelity.readers.own import is_fleet, is_own, open_fleet, open_own
from urbantwin.fidelity.readers.recording import Recording, file_and_choice
from urbantwin.fidelity.readers.roadside import DAIR_V2X, IPS300, LUMPI, ONCE
from urbantwin.fidelity.readers.waymo import is_waymo, open_waymo
from urbantwin.fidelity.readers.webdataset import is_webdataset, open_webdataset
from urbantwin.io.points import FORMATS

__all__ = ["LAYOUTS", "Layout", "layout_of", "open_recording", "recordings_inside"]


@dataclass(frozen=True)
class Layout:
    """A layout of recordings.

    Attributes:
        title: display name.
        detect: returns whether a folder or file has this layout, by names and first bytes.
        open: opens it, with the number of values per row of ``.bin`` files if given.
        verified: whether its reader was checked on real files; otherwise it follows the published
            description alone, which is noted in every recording.
    """

    title: str
    detect: Callable[[Path], bool]
    open: Callable[[Path, int | None], Recording]
    verified: bool


def _without_columns(opens: Callable[[Path], Recording]) -> Callable[[Path, int | None], Recording]:
    return lambda path, _: opens(path)


def _capture(name: str, maker: str, verified: bool) -> Layout:
    return Layout(
        f"a capture of {maker}",
        partial(is_capture_of, name),
        lambda path, _: open_capture(path, name),
        verified,
    )


def _of(dataset: FolderDataset) -> tuple[str, Layout]:
    return dataset.name, Layout(dataset.title, dataset.detect, dataset.open, dataset.verified)


#: Layouts in the order of detection: the most specific first.
LAYOUTS: dict[str, Layout] = {
    "own": Layout("a dataset of urbantwin", is_own, open_own, True),
    "fleet": Layout("a fleet of urbantwin", is_fleet, _without_columns(open_fleet), True),
    "argoverse2": Layout("Argoverse 2", is_argoverse, _without_columns(open_argoverse), True),
    "waymo2": Layout("Waymo Open Dataset v2", is_waymo, _without_columns(open_waymo), False),
    "nuscenes": Layout("nuScenes", is_nuscenes, _without_columns(open_nuscenes), False),
    **dict(map(_of, (ONCE, IPS300, LUMPI, TUMTRAF, DAIR_V2X, SEMANTIC_KITTI))),
    **dict(map(_of, (KITTI, KITTI_TRACKING, KITTI_RAW, OPENCOOD))),
    "rosbag": Layout("a ROS bag", is_rosbag, lambda path, _: open_bag(path, "rosbag"), False),
    "mcap": Layout("MCAP", is_mcap, lambda path, _: open_bag(path, "mcap"), False),
    **{name: _capture(name, maker, name == "ouster") for name, maker in CAPTURES.items()},
    "webdataset": Layout(
        "a WebDataset of urbantwin", is_webdataset, _without_columns(open_webdataset), True
    ),
    "plain": Layout("a folder of clouds", is_plain, open_plain, True),
}
#: Layouts that a single file may have.
_OF_FILES = ("waymo2", "rosbag", "mcap", *CAPTURES, "webdataset", "plain")


def open_recording(
    path: Path, layout: str | None = None, *, columns: int | None = None
) -> Recording:
    """Open a recording of any known layout.

    A folder with a single recording inside is opened as that recording. A note states if the reader
    was not checked on real files.

    Args:
        path: a folder, a cloud, a bag or a capture; after a colon, the topic of a bag or the unit
            of a capture (``a.bag:/lidar/points``, ``a.pcap:192.168.1.201``).
        layout: one of ``LAYOUTS``; detected if not given.
        columns: values per row of ``.bin`` files, if neither 4 nor 3.

    Raises:
        InputError: the path is missing, has no known layout or several recordings, or a table of
            the recording is invalid.
    """
    try:
        recording = _opened(path, layout, columns)
    except OSError as error:
        what = error.strerror or str(error)
        raise InputError(f"is not readable ({what})", file=error.filename or path) from None
    notes = recording.notes
    if not LAYOUTS[recording.layout].verified:
        title = LAYOUTS[recording.layout].title
        notes = (
            *notes,
            f"The reader of {title} was checked by its description, not on real files.",
        )
    again = partial(open_recording, path, layout, columns=columns)
    return replace(recording, notes=notes, again=again)


def _opened(path: Path, layout: str | None, columns: int | None) -> Recording:
    if not file_and_choice(path)[0].exists():
        raise InputError("not found", file=path, expected="a recording or a folder of clouds")
    if layout is not None:
        if layout not in LAYOUTS:
            raise InputError(f"{layout} is unknown", place="layout", expected=", ".join(LAYOUTS))
        if not LAYOUTS[layout].detect(path):
            raise InputError(f"is not laid out as {LAYOUTS[layout].title}", file=path)
        return LAYOUTS[layout].open(path, columns)
    detected = layout_of(path)
    inside = [(path, detected)] if detected is not None else recordings_inside(path)
    if len(inside) == 1:
        place, name = inside[0]
        # all units of a capture are listed, so that the user can choose
        return open_capture(place) if name in CAPTURES else LAYOUTS[name].open(place, columns)
    if inside:
        names = ", ".join(str(folder.relative_to(path)) for folder, _ in inside[:8])
        raise InputError(
            f"holds {len(inside)} recordings", file=path, expected=f"one of them: {names}"
        )
    if path.is_file():
        raise InputError(
            f"holds no clouds, by its name ({path.suffix or 'without an ending'})",
            file=path,
            expected=f"{', '.join(FORMATS)}, .bag, .db3, .mcap or .pcap",
        )
    raise InputError(
        "holds no clouds and no recording that is known",
        file=path,
        expected=", ".join(layout.title for layout in LAYOUTS.values()),
    )


def layout_of(path: Path) -> str | None:
    """Return the layout of a folder or file itself, or None."""
    tried = _OF_FILES if file_and_choice(path)[0].is_file() else LAYOUTS
    return next((name for name in tried if LAYOUTS[name].detect(path)), None)


def recordings_inside(path: Path, depth: int = 2) -> list[tuple[Path, str]]:
    """Return the recordings in the subfolders of a folder, with their layouts."""
    if not path.is_dir():
        return []
    recordings: list[tuple[Path, str]] = []
    for folder in sorted(sub for sub in path.iterdir() if sub.is_dir()):
        layout = layout_of(folder)
        if layout is not None:
            recordings.append((folder, layout))
        elif depth > 1:
            recordings += recordings_inside(folder, depth - 1)
    return recordings
