"""Classes and objects of points as nuScenes-lidarseg and Panoptic nuScenes have them.

Source: Fong et al. 2022, and ``load_lidarseg_cat_name_mapping`` and ``data_io`` of nuscenes-devkit:
a byte for each point, the index of its category; and 1,000 times that plus the object's number in
its scene and category, 0 for none.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.nuscenes_names import CATEGORIES
from urbantwin.exports.frames.scenes import scenes_of
from urbantwin.exports.frames.source import FrameSource
from urbantwin.taxonomy import classes_in, semantic_classes

__all__ = ["LabelledPoints", "unnumbered_objects"]

_MOST_OBJECTS = 999


def unnumbered_objects(source: FrameSource) -> int:
    """Return how many objects with points a category has no numbers for in their scenes."""
    theirs = classes_in("nuscenes")
    beyond = 0
    for scene in scenes_of(source):
        tracks: dict[str | None, set[int]] = defaultdict(set)
        for number in scene.numbers:
            boxes = source.objects.of_frame(source.names[number])
            seen = boxes.num_points > 0
            for kind in np.unique(boxes.class_name[seen]).tolist():
                of_kind = seen & (boxes.class_name == kind)
                tracks[theirs[kind]].update(boxes.track[of_kind].tolist())
        beyond += sum(
            max(0, len(known) - _MOST_OBJECTS) for name, known in tracks.items() if name is not None
        )
    return beyond


class LabelledPoints:
    """Labels of points, frame by frame; objects are numbered as they come, the rest have 0."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, int], dict[int, int]] = defaultdict(dict)
        theirs = classes_in("nuscenes", "point")
        self._of_semantic = np.zeros(1 << 16, np.uint8)
        for name, kind in semantic_classes().items():
            self._of_semantic[kind.id] = CATEGORIES.index(theirs[name] or "noise")
        self._of_box = {
            ours: CATEGORIES.index(name or "noise") for ours, name in classes_in("nuscenes").items()
        }

    def write(self, frame: Frame, scene: str, lidarseg: Path, panoptic: Path) -> None:
        """Write the labels of a frame.

        A point of an actor has the category of its box, which says more: a trailer's points are
        a truck's among our classes of points.

        Args:
            frame: the frame.
            scene: in which objects keep their numbers.
            lidarseg: the file for the categories.
            panoptic: the file for categories and objects.
        """
        category = self._of_semantic[frame.semantic]
        number = np.zeros(len(category), np.uint16)
        boxes = dict(
            zip(frame.objects.track.tolist(), frame.objects.class_name.tolist(), strict=True)
        )
        for track in np.unique(frame.instance[frame.instance > 0]).tolist():
            mine = frame.instance == track
            if track in boxes:
                category[mine] = self._of_box[boxes[track]]
            index = int(category[mine][0])
            if index:
                number[mine] = self._number(scene, index, track)
        category.tofile(lidarseg)
        _write_array(panoptic, category.astype(np.uint16) * 1000 + number)

    def _number(self, scene: str, category: int, track: int) -> int:
        known = self._numbers[scene, category]
        if track not in known:
            known[track] = len(known) + 1 if len(known) < _MOST_OBJECTS else 0
        return known[track]


def _write_array(path: Path, values: NDArray[np.uint16]) -> None:
    np.savez_compressed(path, data=values)
