"""Custom dataset of MMDetection3D 1.4, ready to train: infos, object database, config.

Sources: MMDetection3D 1.4, ``docs/en/advanced_guides/customize_dataset.md``, ``Det3DDataset``
(``metainfo``, ``data_list``, ``instances``), ``create_gt_database.py`` and ``DataBaseSampler``.
Boxes in the infos refer to the box centre, as declared in the accompanying class
(``urbantwin_dataset.py``); those in the object database refer to the centre of the floor, as
MMDetection3D keeps boxes in memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.learned_boxes import LearnedBoxes, ObjectDatabase, learned_boxes
from urbantwin.exports.frames.learned_classes import PILLAR_M, LearnedClasses
from urbantwin.exports.frames.plain_pickle import write_plain_pickle
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.frames.trainer_folder import left_out, write_configs, write_splits
from urbantwin.pages import text_file
from urbantwin.progress import Progress
from urbantwin.taxonomy import classes_in

__all__ = ["losses_mmdet3d", "write_mmdet3d"]


#: Module of the class that reads the dataset, beside its config.
MODULE = "urbantwin_dataset"
#: Models with configs; also the names of the config files. CenterPoint also predicts velocities,
#: which pasted objects lack, so nothing is pasted for it.
CONFIGS = ("pointpillars", "centerpoint")


def dataset_module(class_names: Sequence[str]) -> str:
    """Return the Python module that reads the dataset, as in the tutorial on custom datasets.

    Args:
        class_names: class names of the infos, in order of their numbers.
    """
    return text_file("exports/frames/configs/mmdet3d_dataset.py.j2", names=class_names)


def mmdet3d_config(learned: LearnedClasses, name: str) -> str:
    """Return a config, as Python.

    Args:
        learned: the classes and their range.
        name: one of `CONFIGS`.
    """
    west, south, _, east, north, _ = learned.range_m
    return text_file(
        "exports/frames/configs/mmdet3d.py.j2",
        model=name,
        module=MODULE,
        **learned.config_values,
        grid=[round((north - south) / PILLAR_M), round((east - west) / PILLAR_M)],
        sampled={one.name: one.sampled for one in learned.classes},
    )


#: Class and number of boxes that do not count: -1 is left out everywhere.
_MARKED, _UNKNOWN = "DontCare", -1
_FEATURES = 4


def losses_mmdet3d(source: FrameSource) -> list[str]:
    """Return notes on losses of this format."""
    return left_out(source, f"of the class {_UNKNOWN}, which MMDetection3D leaves out")


def write_mmdet3d(source: FrameSource, folder: Path, tell: Progress) -> Sequence[str]:
    """Write a dataset as a custom dataset of MMDetection3D, with the config to train on it.

    Args:
        source: the dataset.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Returns:
        Notes for the user.
    """
    for name in ("points", "labels"):
        (folder / name).mkdir()
    parts = write_splits(source, folder)
    training = frozenset(parts["train"])
    called = [name for name in classes_in("mmdet3d").values() if name]
    numbers = {name: number for number, name in enumerate(dict.fromkeys(called))}
    database = ObjectDatabase(folder, "custom_gt_database", "floor")
    entries = {}
    for frame in source:
        tell(frame.number / len(source), f"frame {frame.name}")
        points = frame.points
        (folder / "points" / f"{frame.name}.bin").write_bytes(points.tobytes())
        found = learned_boxes(frame.objects, "mmdet3d", _MARKED)
        (folder / "labels" / f"{frame.name}.txt").write_text(found.lines, encoding="utf-8")
        entries[frame.name] = _entry(frame, found, numbers)
        if frame.name in training:
            database.add(frame.name, points, found)
    told = {"dataset": "urbantwin", "info_version": "1.1", "categories": numbers}
    for part, names in parts.items():
        infos = {"metainfo": told, "data_list": [entries[name] for name in names]}
        write_plain_pickle(folder / f"custom_infos_{part}.pkl", infos)
    write_plain_pickle(folder / "custom_dbinfos_train.pkl", _pasted(database))
    (folder / f"{MODULE}.py").write_text(dataset_module(list(numbers)), encoding="utf-8")
    configs = {f"{name}.py": partial(mmdet3d_config, name=name) for name in CONFIGS}
    return write_configs(source, folder, configs)


def _entry(frame: Frame, found: LearnedBoxes, numbers: Mapping[str, int]) -> dict[str, Any]:
    rows = zip(found.names.tolist(), found.box.tolist(), found.rows.tolist(), strict=True)
    return {
        "sample_idx": frame.name,
        "timestamp": frame.time_s,
        "lidar_points": {"num_pts_feats": _FEATURES, "lidar_path": f"{frame.name}.bin"},
        "instances": [
            {
                "bbox_3d": box,
                "bbox_label_3d": numbers.get(name, _UNKNOWN),
                "num_lidar_pts": int(frame.objects.num_points[row]),
                "velocity": frame.objects.velocity[row, :2].tolist(),
                "track_id": int(frame.objects.track[row]),
            }
            for name, box, row in rows
        ],
    }


def _pasted(database: ObjectDatabase) -> dict[str, list[dict[str, Any]]]:
    """Return the table of objects with the additional keys of ``create_gt_database.py``."""
    return {
        name: [
            one | {"image_idx": Path(one["path"]).name.split("_")[0], "difficulty": 0}
            for one in infos
        ]
        for name, infos in database.infos.items()
        if name != _MARKED
    }
