"""nuScenes: its tables, and the clouds of ``LIDAR_TOP``; every frame is a key frame.

Writes the thirteen tables, and those of point labels: ``lidarseg`` and ``panoptic``.

Source: Caesar et al. 2020, and the schema and code of nuscenes-devkit 1.2.0. Points are in the
frame of the LiDAR with x to the right and y forward; boxes and ego poses are in the site, which is
the global frame. Sizes are width, length, height, rotations w, x, y, z, times microseconds.
"""

from __future__ import annotations

from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from urbantwin.artefact import sha256_of, write_json
from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.box_poses import site_boxes
from urbantwin.exports.frames.nuscenes_names import CATEGORIES, scene_names
from urbantwin.exports.frames.nuscenes_tables import (
    CHANNEL,
    STREAMED,
    TablesOfFrames,
    open_table,
)
from urbantwin.exports.frames.scenes import scenes_of
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress, each
from urbantwin.taxonomy import classes_in, semantic_classes

__all__ = ["losses_nuscenes", "write_nuscenes"]


_MOST_OBJECTS = 999


def unnumbered_objects(source: FrameSource) -> int:
    """Return the number of objects with points beyond the panoptic numbers of their category."""
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
    """Point labels, frame by frame; objects are numbered in order of appearance, others are 0."""

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

        A point of an actor has the category of its box, which is more specific: points of a trailer
        have the semantic class of a truck.

        Args:
            frame: the frame.
            scene: scene within which objects keep their numbers.
            lidarseg: file of the categories.
            panoptic: file of categories and objects.
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


#: Folder of the tables, as training tools expect it.
VERSION = "v1.0-trainval"
#: Scale of nuScenes' intensity, 0..255 in integers.
INTENSITY = 255
#: Names of the parts in ``splits.json``; the devkit's own names mean its own scenes.
CUSTOM_SPLIT = "urbantwin_{}"
_MASK_PIXELS = 1000
#: Classes of the detection task, with the range within which objects count, metres
#: (``detection_cvpr_2019.json``); and the class of each category (``category_to_detection_name``).
_RANGES_M = {
    **dict.fromkeys(("car", "truck", "bus", "trailer", "construction_vehicle"), 50.0),
    **dict.fromkeys(("pedestrian", "motorcycle", "bicycle"), 40.0),
    **dict.fromkeys(("traffic_cone", "barrier"), 30.0),
}
_DETECTED = {
    "human.pedestrian.adult": "pedestrian",
    "human.pedestrian.child": "pedestrian",
    "human.pedestrian.construction_worker": "pedestrian",
    "human.pedestrian.police_officer": "pedestrian",
    "movable_object.barrier": "barrier",
    "movable_object.trafficcone": "traffic_cone",
    "vehicle.bicycle": "bicycle",
    "vehicle.bus.bendy": "bus",
    "vehicle.bus.rigid": "bus",
    "vehicle.car": "car",
    "vehicle.construction": "construction_vehicle",
    "vehicle.motorcycle": "motorcycle",
    "vehicle.trailer": "trailer",
    "vehicle.truck": "truck",
}
#: Point label tasks, with the suffix of their files.
_OF_POINTS = {"lidarseg": "bin", "panoptic": "npz"}


def losses_nuscenes(source: FrameSource) -> list[str]:
    """Return notes on lost precision."""
    told = ["of boxes: occlusion becomes one of nuScenes' four levels of visibility"]
    if len(scenes_of(source)) > 1:
        told.append("of boxes: a track is followed within a scene, as in nuScenes, not across two")
    beyond = unnumbered_objects(source)
    if beyond:
        told.append(f"of points: {beyond} instances, beyond 999 of a category in a scene")
    return told if source.labelled_classes else []


def write_nuscenes(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write a dataset as nuScenes: ``v1.0-trainval/``, ``samples/LIDAR_TOP/`` and ``maps/``.

    Args:
        source: the dataset.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Returns:
        Notes for the user.
    """
    (folder / "samples" / CHANNEL).mkdir(parents=True)
    (folder / "maps").mkdir()
    (folder / VERSION).mkdir()
    for task in _OF_POINTS:
        (folder / task / VERSION).mkdir(parents=True)
    found = scenes_of(source)
    scenes = dict(zip(scene_names([scene.part for scene in found]), found, strict=True))
    tables = TablesOfFrames(source, sha256_of(source.folder / "dataset.json"), scenes)
    points = LabelledPoints()
    in_range: set[str] = set()
    with ExitStack() as opened:
        for table in STREAMED:
            path = folder / VERSION / f"{table}.json"
            tables.rows[table] = opened.enter_context(open_table(path))
        for number in each(range(len(source)), tell, "frames"):
            frame = source[number]
            files = {"sample_data": f"samples/{CHANNEL}/{frame.name}.pcd.bin"} | {
                task: f"{task}/{VERSION}/{tables.sweep(frame)}_{task}.{ending}"
                for task, ending in _OF_POINTS.items()
            }
            tables.add(frame, files)
            cloud, lidarseg, panoptic = (folder / file for file in files.values())
            _write_cloud(cloud, frame)
            in_range |= _detected_classes(frame)
            points.write(frame, tables.scene_of(number), lidarseg, panoptic)
    for table, rows in tables.small_tables().items():
        write_json(folder / VERSION / f"{table}.json", rows)
    splits: dict[str, list[str]] = {CUSTOM_SPLIT.format(part): [] for part in source.splits}
    for name, scene in scenes.items():
        if scene.part is not None:
            splits[CUSTOM_SPLIT.format(scene.part)].append(name)
    write_json(folder / VERSION / "splits.json", splits)
    Image.new("L", (_MASK_PIXELS, _MASK_PIXELS)).save(folder / tables.map_file)
    parts = ", ".join(f"{key} {len(names)}" for key, names in splits.items()) or "none"
    return [
        f"every frame is a key frame ({source.rate_hz:g} a second): there are no sweeps between",
        f"scenes of each split ({VERSION}/splits.json): {parts}",
        *_ceiling(in_range),
    ]


def _detected_classes(frame: Frame) -> set[str]:
    """Return the classes of the detection task with an object in range in a frame."""
    boxes = frame.objects
    categories = classes_in("nuscenes")
    sensor = next(iter(frame.site_SE3_sensors.values())).translation
    away = np.linalg.norm((site_boxes(frame)[0] - sensor)[:, :2], axis=1)
    found = set()
    for name in set(boxes.class_name.tolist()):
        detected = _DETECTED.get(categories.get(name) or "")
        mine = (boxes.class_name == name) & (boxes.num_points > 0)
        if detected is not None and (away[mine] <= _RANGES_M[detected]).any():
            found.add(detected)
    return found


def _ceiling(found: set[str]) -> list[str]:
    """Return a note on the largest mean AP that is possible with the present classes."""
    if len(found) == len(_RANGES_M):
        return []
    return [
        f"of the detection task's {len(_RANGES_M)} classes {len(found)} have an object with points "
        f"in range ({', '.join(sorted(found)) or 'none'}): a perfect detector has mAP "
        f"{len(found) / len(_RANGES_M):.1f}, as a class without objects counts 0"
    ]


def _write_cloud(path: Path, frame: Frame) -> None:
    """Write x, y, z, intensity, ring as float32."""
    rows = np.zeros((len(frame.points), 5), "<f4")
    rows[:, 0], rows[:, 1], rows[:, 2] = -frame.points[:, 1], frame.points[:, 0], frame.points[:, 2]
    rows[:, 3] = frame.intensity * np.float32(INTENSITY)
    if "ring" in (frame.rays.dtype.names or ()):
        rows[:, 4] = frame.rays["ring"]
    rows.tofile(path)
