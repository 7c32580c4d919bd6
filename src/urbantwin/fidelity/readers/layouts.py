"""Detection of the dataset layout of a folder by its content."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import FORMATS
from urbantwin.fidelity.readers.argoverse import is_argoverse, open_argoverse
from urbantwin.fidelity.readers.bags import is_mcap, is_rosbag, open_bag
from urbantwin.fidelity.readers.captures import CAPTURES, is_capture_of, open_capture
from urbantwin.fidelity.readers.choice import file_and_choice
from urbantwin.fidelity.readers.dair_v2x import is_dair, open_dair
from urbantwin.fidelity.readers.fleet import is_fleet, open_fleet
from urbantwin.fidelity.readers.ips300 import is_ips300, open_ips300
from urbantwin.fidelity.readers.kitti import is_kitti, open_kitti
from urbantwin.fidelity.readers.lumpi import is_lumpi, open_lumpi
from urbantwin.fidelity.readers.nuscenes import is_nuscenes, open_nuscenes
from urbantwin.fidelity.readers.once import is_once, open_once
from urbantwin.fidelity.readers.opencood import is_opencood, open_opencood
from urbantwin.fidelity.readers.own import is_own, open_own
from urbantwin.fidelity.readers.plain import is_plain, open_plain
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.semantic_kitti import is_semantic_kitti, open_semantic_kitti
from urbantwin.fidelity.readers.tumtraf import is_tumtraf, open_tumtraf
from urbantwin.fidelity.readers.waymo import is_waymo, open_waymo
from urbantwin.fidelity.readers.webdataset import is_webdataset, open_webdataset

__all__ = ["LAYOUTS", "Layout", "layout_of", "open_recording", "recordings_inside"]


@dataclass(frozen=True)
class Layout:
    """One way that recordings are laid out.

    Attributes:
        title: for people.
        recognises: whether a folder or file is laid out so; looks at names, not into clouds.
        opens: opens it, with the number of values in a row of ``.bin`` files if it is given.
    """

    title: str
    recognises: Callable[[Path], bool]
    opens: Callable[[Path, int | None], Recording]


def _open_capture(layout: str, path: Path, columns: int | None) -> Recording:
    return open_capture(path, layout)


#: In the order in which they are tried: what says most about itself first.
LAYOUTS: dict[str, Layout] = {
    "own": Layout("a dataset of urbantwin", is_own, open_own),
    "fleet": Layout("a fleet of urbantwin", is_fleet, lambda path, _: open_fleet(path)),
    "argoverse2": Layout("Argoverse 2", is_argoverse, lambda path, _: open_argoverse(path)),
    "waymo2": Layout("Waymo Open Dataset v2", is_waymo, lambda path, _: open_waymo(path)),
    "nuscenes": Layout("nuScenes", is_nuscenes, lambda path, _: open_nuscenes(path)),
    "once": Layout("ONCE", is_once, lambda path, _: open_once(path)),
    "ips300": Layout("IPS300+", is_ips300, lambda path, _: open_ips300(path)),
    "lumpi": Layout("LUMPI", is_lumpi, lambda path, _: open_lumpi(path)),
    "tumtraf": Layout("TUMTraf", is_tumtraf, lambda path, _: open_tumtraf(path)),
    "dair-v2x": Layout("DAIR-V2X", is_dair, lambda path, _: open_dair(path)),
    "semantic-kitti": Layout("SemanticKITTI", is_semantic_kitti, open_semantic_kitti),
    "kitti": Layout("KITTI", is_kitti, open_kitti),
    "opencood": Layout(
        "OPV2V, V2X-Real or V2V4Real", is_opencood, lambda path, _: open_opencood(path)
    ),
    "rosbag": Layout("a ROS bag", is_rosbag, lambda path, _: open_bag(path, "rosbag")),
    "mcap": Layout("MCAP", is_mcap, lambda path, _: open_bag(path, "mcap")),
    **{
        name: Layout(
            f"a capture of {maker}",
            partial(is_capture_of, name),
            partial(_open_capture, name),
        )
        for name, maker in CAPTURES.items()
    },
    "webdataset": Layout(
        "a WebDataset of urbantwin", is_webdataset, lambda path, _: open_webdataset(path)
    ),
    "plain": Layout("a folder of clouds", is_plain, open_plain),
}
#: Those that a single file may have.
_OF_FILES = ("waymo2", "rosbag", "mcap", *CAPTURES, "webdataset", "plain")


def open_recording(
    path: Path, layout: str | None = None, *, columns: int | None = None
) -> Recording:
    """Open a recording of any layout that is known.

    A folder that holds nothing but one recording stands for it.

    Args:
        path: a folder, a cloud, a bag or a capture; behind a colon, which topic of a bag or which
            unit of a capture (``a.bag:/lidar/points``, ``a.pcap:192.168.1.201``).
        layout: one of ``LAYOUTS``; found by what is in the folder if it is not given.
        columns: values per row of ``.bin`` files, where it is neither 4 nor 3.

    Raises:
        InputError: nothing is there, or nothing that is known, or several recordings; or a table
            that belongs to the recording is not right.
    """
    try:
        recording = _opened(path, layout, columns)
    except OSError as error:
        what = error.strerror or str(error)
        raise InputError(f"is not readable ({what})", file=error.filename or path) from None
    return replace(recording, again=partial(open_recording, path, layout, columns=columns))


def _opened(path: Path, layout: str | None, columns: int | None) -> Recording:
    if not file_and_choice(path)[0].exists():
        raise InputError("not found", file=path, expected="a recording or a folder of clouds")
    if layout is not None:
        if layout not in LAYOUTS:
            raise InputError(f"{layout} is unknown", place="layout", expected=", ".join(LAYOUTS))
        if not LAYOUTS[layout].recognises(path):
            raise InputError(f"is not laid out as {LAYOUTS[layout].title}", file=path)
        return LAYOUTS[layout].opens(path, columns)
    found = layout_of(path)
    inside = [(path, found)] if found is not None else recordings_inside(path)
    if len(inside) == 1:
        place, name = inside[0]
        # Of a capture, all units are looked at: of several, a person is asked which.
        return open_capture(place) if name in CAPTURES else LAYOUTS[name].opens(place, columns)
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
        expected=", ".join(one.title for one in LAYOUTS.values()),
    )


def layout_of(path: Path) -> str | None:
    """Return which of ``LAYOUTS`` a folder or file itself has, or None."""
    tried = _OF_FILES if file_and_choice(path)[0].is_file() else LAYOUTS
    return next((name for name in tried if LAYOUTS[name].recognises(path)), None)


def recordings_inside(path: Path, depth: int = 2) -> list[tuple[Path, str]]:
    """Return the recordings in the folders of a folder, not looking into those of one."""
    if not path.is_dir():
        return []
    found: list[tuple[Path, str]] = []
    for folder in sorted(one for one in path.iterdir() if one.is_dir()):
        layout = layout_of(folder)
        if layout is not None:
            found.append((folder, layout))
        elif depth > 1:
            found += recordings_inside(folder, depth - 1)
    return found
