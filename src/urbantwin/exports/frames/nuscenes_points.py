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

from urbantwin.exports.frames.nuscenes_names import CATEGORIES
from urbantwin.exports.frames.source import SourceFrame
from urbantwin.taxonomy import classes_in, semantic_classes

__all__ = ["LabelledPoints"]

_MOST_OBJECTS = 999


class LabelledPoints:
    """Labels of points, frame by frame; objects are numbered as they come.

    Attributes:
        unnumbered: objects beyond those that a category has numbers for in a scene.
    """

    def __init__(self) -> None:
        self.unnumbered = 0
        self._numbers: dict[tuple[str, int], dict[int, int]] = defaultdict(dict)
        theirs = classes_in("nuscenes", "point")
        self._of_semantic = np.zeros(1 << 16, np.uint8)
        for name, kind in semantic_classes().items():
            self._of_semantic[kind.id] = CATEGORIES.index(theirs[name] or "noise")
        self._of_box = {
            ours: CATEGORIES.index(name or "noise") for ours, name in classes_in("nuscenes").items()
        }

    def write(self, frame: SourceFrame, scene: str, lidarseg: Path, panoptic: Path) -> None:
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
        boxes = dict(zip(frame.boxes.track.tolist(), frame.boxes.class_name.tolist(), strict=True))
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
            full = len(known) >= _MOST_OBJECTS
            self.unnumbered += full
            known[track] = 0 if full else len(known) + 1
        return known[track]


def _write_array(path: Path, values: NDArray[np.uint16]) -> None:
    np.savez_compressed(path, data=values)
