"""A custom dataset of MMDetection3D 1.4, ready to train: infos, objects to paste, a config.

Sources: MMDetection3D 1.4, ``docs/en/advanced_guides/customize_dataset.md``, ``Det3DDataset``
(``metainfo``, ``data_list``, ``instances``), ``create_gt_database.py`` and ``DataBaseSampler``.
Boxes in the infos have the middle of the box, and the class that comes with them
(``urbantwin_dataset.py``) says so; those of the objects to paste have the middle of the floor, as
MMDetection3D keeps boxes in memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from pprint import pformat
from typing import Any

from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.learned_boxes import LearnedBoxes, ObjectDatabase, learned_boxes
from urbantwin.exports.frames.learned_classes import FEWEST_POINTS, LearnedClasses
from urbantwin.exports.frames.mmdet3d_models import centerpoint, pointpillars
from urbantwin.exports.frames.plain_pickle import write_plain_pickle
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.frames.trainer_folder import left_out, write_configs, write_splits
from urbantwin.progress import Progress
from urbantwin.taxonomy import classes_in

__all__ = ["losses_mmdet3d", "write_mmdet3d"]


#: Module of the class that reads the dataset, beside its config.
MODULE = "urbantwin_dataset"
_CLASS = "UrbanTwinDataset"
#: The models that there are configs for; a config's file is named so. CenterPoint tells velocities,
#: too, which objects that are pasted in do not have: nothing is pasted for it.
CONFIGS = {"pointpillars": (pointpillars, False), "centerpoint": (centerpoint, True)}
#: Where MMDetection3D's own configs look, from its folder.
_DATA_ROOT = "data/custom/"
_EPOCHS, _RATE = 80, 0.001
_LIDAR = {"use_lidar": True, "use_camera": False}


def dataset_module(class_names: Sequence[str]) -> str:
    """Return the module that reads the dataset: what the tutorial on custom datasets asks for.

    Args:
        class_names: of the infos, in the order of their numbers.
    """
    names = "".join(f'            "{name}",\n' for name in class_names)
    return f'''"""Reads a dataset that urbantwin exported (MMDetection3D 1.4)."""

import numpy as np
from mmdet3d.datasets.det3d_dataset import Det3DDataset
from mmdet3d.registry import DATASETS
from mmdet3d.structures import LiDARInstance3DBoxes


@DATASETS.register_module()
class {_CLASS}(Det3DDataset):
    METAINFO = {{
        "classes": (
{names}        )
    }}

    def __init__(self, *args, with_velocity=False, **kwargs):
        self.with_velocity = with_velocity
        super().__init__(*args, **kwargs)

    def parse_ann_info(self, info):
        found = super().parse_ann_info(info)
        if found is None:  # a frame without boxes
            found = {{
                "gt_bboxes_3d": np.zeros((0, 7), np.float32),
                "gt_labels_3d": np.zeros(0, np.int64),
                "velocities": np.zeros((0, 2), np.float32),
            }}
        found = self._remove_dontcare(found)
        boxes = found["gt_bboxes_3d"]
        if self.with_velocity:
            boxes = np.concatenate([boxes, found["velocities"]], axis=1)
        found["gt_bboxes_3d"] = LiDARInstance3DBoxes(
            boxes, box_dim=boxes.shape[1], origin=(0.5, 0.5, 0.5)
        ).convert_to(self.box_mode_3d)
        return found
'''


def mmdet3d_config(learned: LearnedClasses, name: str) -> str:
    """Return a config, as Python.

    Args:
        learned: the classes, and where they are.
        name: one of `CONFIGS`.
    """
    model, with_velocity = CONFIGS[name]
    names, reach = learned.names, list(learned.range_m)
    load: dict[str, Any] = {
        "type": "LoadPointsFromFile",
        "coord_type": "LIDAR",
        "load_dim": 4,
        "use_dim": 4,
    }
    within: dict[str, Any] = {"type": "PointsRangeFilter", "point_cloud_range": reach}
    sampler = {
        "data_root": _DATA_ROOT,
        "info_path": _DATA_ROOT + "custom_dbinfos_train.pkl",
        "rate": 1.0,
        "prepare": {"filter_by_min_points": dict.fromkeys(names, FEWEST_POINTS)},
        "classes": names,
        "sample_groups": {one.name: one.sampled for one in learned.classes},
        "points_loader": load,
    }
    train: list[dict[str, Any]] = [
        load,
        {"type": "LoadAnnotations3D", "with_bbox_3d": True, "with_label_3d": True},
        *([] if with_velocity else [{"type": "ObjectSample", "db_sampler": sampler}]),
        {
            "type": "RandomFlip3D",
            "flip_ratio_bev_horizontal": 0.5,
            "flip_ratio_bev_vertical": 0.5,
        },
        {
            "type": "GlobalRotScaleTrans",
            "rot_range": [-3.14159, 3.14159],
            "scale_ratio_range": [0.95, 1.05],
        },
        within,
        {"type": "ObjectRangeFilter", "point_cloud_range": reach},
        {"type": "ObjectNameFilter", "classes": names},
        {"type": "PointShuffle"},
        {"type": "Pack3DDetInputs", "keys": ["points", "gt_bboxes_3d", "gt_labels_3d"]},
    ]
    test: list[dict[str, Any]] = [load, within, {"type": "Pack3DDetInputs", "keys": ["points"]}]
    told = {"with_velocity": with_velocity}
    judged = {
        "batch_size": 1,
        "num_workers": 1,
        "persistent_workers": True,
        "drop_last": False,
        "sampler": {"type": "DefaultSampler", "shuffle": False},
        "dataset": _dataset("val", names, test, judged=True) | told,
    }
    judge = {"type": "IndoorMetric", "iou_thr": [0.3, 0.5, 0.7]}
    parts: dict[str, Any] = {
        "default_scope": "mmdet3d",
        "custom_imports": {"imports": [MODULE], "allow_failed_imports": False},
        "class_names": names,
        "point_cloud_range": reach,
        "model": model(learned),
        "train_dataloader": {
            "batch_size": 4,
            "num_workers": 4,
            "persistent_workers": True,
            "sampler": {"type": "DefaultSampler", "shuffle": True},
            "dataset": _dataset("train", names, train, judged=False) | told,
        },
        "val_dataloader": judged,
        "test_dataloader": judged,
        "val_evaluator": judge,
        "test_evaluator": judge,
        **_schedule(),
    }
    text = "".join(
        f"{one} = {pformat(value, width=96, sort_dicts=False)}\n" for one, value in parts.items()
    )
    return (
        f"# For this dataset, which MMDetection3D looks for in {_DATA_ROOT} and reads by\n"
        f"# {MODULE}.py. In MMDetection3D's folder:\n"
        f"# PYTHONPATH={_DATA_ROOT[:-1]}:$PYTHONPATH python tools/train.py {_DATA_ROOT}{name}.py\n"
        + text
    )


def _dataset(
    part: str, names: Sequence[str], pipeline: list[dict[str, Any]], *, judged: bool
) -> dict[str, Any]:
    return {
        "type": _CLASS,
        "data_root": _DATA_ROOT,
        "ann_file": f"custom_infos_{part}.pkl",
        "data_prefix": {"pts": "points"},
        "pipeline": pipeline,
        "modality": _LIDAR,
        "metainfo": {"classes": list(names)},
        "box_type_3d": "LiDAR",
        "test_mode": judged,
    }


def _schedule() -> dict[str, Any]:
    """Return how long and how fast: that of ``configs/pointpillars``."""
    rising = round(_EPOCHS * 0.4)

    def phase(kind: str, least: float, begin: int, end: int) -> dict[str, Any]:
        return {
            "type": kind,
            "T_max": end - begin,
            "eta_min": least,
            "begin": begin,
            "end": end,
            "by_epoch": True,
            "convert_to_iter_based": True,
        }

    rate, momentum = "CosineAnnealingLR", "CosineAnnealingMomentum"
    return {
        "optim_wrapper": {
            "type": "OptimWrapper",
            "optimizer": {
                "type": "AdamW",
                "lr": _RATE,
                "betas": (0.95, 0.99),
                "weight_decay": 0.01,
            },
            "clip_grad": {"max_norm": 35, "norm_type": 2},
        },
        "param_scheduler": [
            phase(rate, _RATE * 10, 0, rising),
            phase(rate, _RATE * 1e-4, rising, _EPOCHS),
            phase(momentum, 0.85 / 0.95, 0, rising),
            phase(momentum, 1, rising, _EPOCHS),
        ],
        "train_cfg": {"by_epoch": True, "max_epochs": _EPOCHS, "val_interval": 10},
        "val_cfg": {},
        "test_cfg": {},
        "default_hooks": {
            "timer": {"type": "IterTimerHook"},
            "logger": {"type": "LoggerHook", "interval": 50},
            "param_scheduler": {"type": "ParamSchedulerHook"},
            "checkpoint": {"type": "CheckpointHook", "interval": 10},
            "sampler_seed": {"type": "DistSamplerSeedHook"},
        },
        "log_level": "INFO",
    }


#: Class and number of boxes that do not count: -1 is left out everywhere.
_MARKED, _UNKNOWN = "DontCare", -1
_FEATURES = 4


def losses_mmdet3d(source: FrameSource) -> list[str]:
    """Return what is lost besides what the format cannot hold."""
    return left_out(source, f"of the class {_UNKNOWN}, which MMDetection3D leaves out")


def write_mmdet3d(source: FrameSource, folder: Path, tell: Progress) -> Sequence[str]:
    """Write a dataset as a custom dataset of MMDetection3D, with the config to train on it.

    Args:
        source: the dataset.
        folder: to write into.
        tell: told how far it is.

    Returns:
        What a person should be told.
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
    """Return the table of objects with the keys that ``create_gt_database.py`` has besides."""
    return {
        name: [
            one | {"image_idx": Path(one["path"]).name.split("_")[0], "difficulty": 0}
            for one in infos
        ]
        for name, infos in database.infos.items()
        if name != _MARKED
    }
