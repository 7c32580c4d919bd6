"""OpenPCDet's custom dataset, ready to train, including the output of ``create_custom_infos``.

Sources: OpenPCDet, ``docs/CUSTOM_DATASET_TUTORIAL.md`` and
``pcdet/datasets/custom/custom_dataset.py`` (``get_infos``, ``create_groundtruth_database``). Two
differences from its output: frames without boxes are supported (it fails for an empty file), and
names have room for KITTI's, which its evaluation writes over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from urbantwin.artefact import check_file, replaced_file
from urbantwin.dataset.reading.columns import POINT
from urbantwin.dataset.reading.frame_files import stored_frames
from urbantwin.exports.frames.learned_boxes import LearnedBoxes, ObjectDatabase, learned_boxes
from urbantwin.exports.frames.learned_classes import (
    LearnedClasses,
    learned_classes,
)
from urbantwin.exports.frames.plain_pickle import write_plain_pickle
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.frames.trainer_folder import left_out, write_configs, write_splits
from urbantwin.pages import text_file
from urbantwin.progress import Progress
from urbantwin.taxonomy import classes_in

__all__ = ["losses_openpcdet", "write_openpcdet", "write_openpcdet_config"]


#: Class of boxes that OpenPCDet ignores in training and evaluation.
DONT_CARE = "DontCare"
#: Models with configs; also the names of the config files.
CONFIGS = ("pointpillar", "centerpoint")


def openpcdet_config(learned: LearnedClasses, data_path: str, model: str = "pointpillar") -> str:
    """Return a config as YAML.

    Args:
        learned: the classes and their range.
        data_path: path of the dataset for OpenPCDet's programs.
        model: one of `CONFIGS`.
    """
    in_kitti = {
        name: _evaluated_as(name) if name in learned.names else DONT_CARE
        for name in dict.fromkeys((*learned.names, *learned.labelled))
    }
    return text_file(
        "exports/frames/configs/openpcdet.yaml.j2",
        model=model,
        data_path=data_path,
        **learned.config_values,
        in_kitti=in_kitti | {DONT_CARE: DONT_CARE},
        point=POINT,
    )


def _evaluated_as(name: str) -> str:
    """Return KITTI's name of a class, among those supported by its evaluation."""
    called = classes_in("kitti").get(name)
    return DONT_CARE if called in (None, "Misc") else "Truck" if called == "Tram" else str(called)


#: Data path in OpenPCDet's own configs, relative to its folder ``tools``.
_DATA_PATH = "../data/custom"
_COMMAND = """# In OpenPCDet's folder tools, with this folder at FOLDER:
# python train.py --cfg_file FOLDER/{}.yaml --set DATA_CONFIG.DATA_PATH FOLDER
"""
_FEATURES = 4


def losses_openpcdet(source: FrameSource) -> list[str]:
    """Return notes on losses of this format."""
    return left_out(source, f"{DONT_CARE}, which OpenPCDet neither learns nor judges by")


def write_openpcdet(source: FrameSource, folder: Path, tell: Progress) -> Sequence[str]:
    """Write a dataset as OpenPCDet's custom dataset, with the configs to train on it.

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
    database = ObjectDatabase(folder, "gt_database")
    infos = {}
    for number, frame in enumerate(source):
        tell(number / len(source), f"frame {frame.name}")
        points = frame.points
        np.save(folder / "points" / f"{frame.name}.npy", points)
        found = learned_boxes(frame.objects, "openpcdet", DONT_CARE)
        (folder / "labels" / f"{frame.name}.txt").write_text(found.lines, encoding="utf-8")
        infos[frame.name] = _info(frame.name, found)
        if frame.name in training:
            database.add(frame.name, points, found)
    for part, names in parts.items():
        write_plain_pickle(
            folder / f"custom_infos_{part}.pkl", [infos[name] for name in names if name in infos]
        )
    write_plain_pickle(folder / "custom_dbinfos_train.pkl", dict(database.infos))
    configs = {f"{name}.yaml": partial(_config_to_train, model=name) for name in CONFIGS}
    return write_configs(source, folder, configs)


def _config_to_train(learned: LearnedClasses, model: str) -> str:
    return _COMMAND.format(model) + openpcdet_config(learned, _DATA_PATH, model)


def write_openpcdet_config(dataset: Path, file: Path) -> list[str]:
    """Write a config to train PointPillars on an unchanged dataset with OpenPCDet.

    Args:
        dataset: folder of an UrbanTwin dataset.
        file: file to write.

    Returns:
        Notes for the user.

    Raises:
        InputError: not an UrbanTwin dataset, or no class has enough boxes.
    """
    check_file(file, kind="openpcdet", inputs=[dataset])
    learned = learned_classes(dataset)
    with replaced_file(file, kind="openpcdet", inputs=[dataset]) as passing:
        passing.write_text(openpcdet_config(learned, str(dataset.resolve())), encoding="utf-8")
    notes = [
        *learned.notes,
        f"DATA_PATH is {dataset}, whose labels have the boxes without a point, too: -o folder/ "
        "writes a dataset without them",
    ]
    if stored_frames(dataset):
        notes.append("OpenPCDet reads points/*.npy, and these are kept in columns: -o folder/ too")
    return notes


def _info(name: str, found: LearnedBoxes) -> dict[str, object]:
    return {
        "point_cloud": {"num_features": _FEATURES, "lidar_idx": name},
        "annos": {"name": found.names, "gt_boxes_lidar": found.box},
    }
