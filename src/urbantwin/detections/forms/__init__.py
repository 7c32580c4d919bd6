"""Detections as other programs write them: KITTI's text, OpenPCDet's pickle, nuScenes' JSON."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from urbantwin.detections.detections import Detections
from urbantwin.detections.folder import read_detections
from urbantwin.detections.forms.kitti_text import is_kitti_text, read_kitti_text
from urbantwin.detections.forms.nuscenes_json import nuscenes_file, read_nuscenes_json
from urbantwin.detections.forms.openpcdet import openpcdet_file, read_openpcdet
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import Recording

__all__ = ["read_any_form"]


def read_any_form(
    path: Path, recording: Callable[[], Recording] | None
) -> tuple[Detections, tuple[str, ...]]:
    """Read detections in whatever form they are; return them, and what a reader must know.

    Args:
        path: a folder or a file.
        recording: opens the recording that they are of: KITTI's are in the frame of a camera,
            nuScenes' in the world, and only a recording says where these are.

    Raises:
        InputError: it is none of the forms, a file is damaged, or there is no recording.
    """
    if (path / "detections.json").is_file():
        return read_detections(path), ()
    file = openpcdet_file(path)
    if file is not None:
        return read_openpcdet(file)
    file = nuscenes_file(path)
    if file is not None:
        return read_nuscenes_json(file, _opened(recording, path))
    if is_kitti_text(path):
        return read_kitti_text(path, _opened(recording, path))
    raise InputError(
        "holds no detections" if path.exists() else "is not there",
        file=path,
        expected="detections.json of `urbantwin model detect`, KITTI's texts (16 values a line), "
        "OpenPCDet's result.pkl or nuScenes' results.json",
    )


def _opened(recording: Callable[[], Recording] | None, path: Path) -> Recording:
    if recording is None:
        raise InputError(
            "is not in the frame of the points", file=path, expected="the frames that it is of"
        )
    return recording()
