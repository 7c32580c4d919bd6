"""A config of MMDetection3D for a dataset, PointPillars, and the class that reads the dataset.

Source: MMDetection3D 1.4, ``configs/pointpillars``, ``configs/_base_/datasets/kitti-3d-3class.py``
and ``docs/en/advanced_guides/customize_dataset.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pprint import pformat
from typing import Any

from urbantwin.exports.frames.learned_classes import (
    FEWEST_POINTS,
    PILLAR_M,
    LearnedClass,
    LearnedClasses,
)

__all__ = ["MODULE", "dataset_module", "mmdet3d_config"]

#: Module of the class that reads the dataset, beside its config.
MODULE = "urbantwin_dataset"
_CLASS = "UrbanTwinDataset"
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

    def parse_ann_info(self, info):
        found = super().parse_ann_info(info)
        if found is None:  # a frame without boxes
            found = {{
                "gt_bboxes_3d": np.zeros((0, 7), np.float32),
                "gt_labels_3d": np.zeros(0, np.int64),
            }}
        found = self._remove_dontcare(found)
        found["gt_bboxes_3d"] = LiDARInstance3DBoxes(
            found["gt_bboxes_3d"], origin=(0.5, 0.5, 0.5)
        ).convert_to(self.box_mode_3d)
        return found
'''


def mmdet3d_config(learned: LearnedClasses) -> str:
    """Return the config, as Python.

    Args:
        learned: the classes, and where they are.
    """
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
        {"type": "ObjectSample", "db_sampler": sampler},
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
    judged = {
        "batch_size": 1,
        "num_workers": 1,
        "persistent_workers": True,
        "drop_last": False,
        "sampler": {"type": "DefaultSampler", "shuffle": False},
        "dataset": _dataset("val", names, test, judged=True),
    }
    judge = {"type": "IndoorMetric", "iou_thr": [0.3, 0.5, 0.7]}
    parts: dict[str, Any] = {
        "default_scope": "mmdet3d",
        "custom_imports": {"imports": [MODULE], "allow_failed_imports": False},
        "class_names": names,
        "point_cloud_range": reach,
        "model": _model(learned),
        "train_dataloader": {
            "batch_size": 4,
            "num_workers": 4,
            "persistent_workers": True,
            "sampler": {"type": "DefaultSampler", "shuffle": True},
            "dataset": _dataset("train", names, train, judged=False),
        },
        "val_dataloader": judged,
        "test_dataloader": judged,
        "val_evaluator": judge,
        "test_evaluator": judge,
        **_schedule(),
    }
    text = "".join(
        f"{name} = {pformat(value, width=96, sort_dicts=False)}\n" for name, value in parts.items()
    )
    return (
        f"# PointPillars for this dataset, which MMDetection3D looks for in {_DATA_ROOT}\n"
        f"# and reads by {MODULE}.py. In MMDetection3D's folder:\n"
        f"# PYTHONPATH={_DATA_ROOT[:-1]}:$PYTHONPATH python tools/train.py "
        f"{_DATA_ROOT}pointpillars.py\n" + text
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


def _assigner(one: LearnedClass) -> dict[str, Any]:
    return {
        "type": "Max3DIoUAssigner",
        "iou_calculator": {"type": "mmdet3d.BboxOverlapsNearest3D"},
        "pos_iou_thr": one.matched,
        "neg_iou_thr": one.unmatched,
        "min_pos_iou": one.unmatched,
        "ignore_iof_thr": -1,
    }


def _model(learned: LearnedClasses) -> dict[str, Any]:
    west, south, low, east, north, high = learned.range_m
    voxel = [PILLAR_M, PILLAR_M, round(high - low, 1)]
    reach = list(learned.range_m)
    rows, columns = round((north - south) / PILLAR_M), round((east - west) / PILLAR_M)
    return {
        "type": "VoxelNet",
        "data_preprocessor": {
            "type": "Det3DDataPreprocessor",
            "voxel": True,
            "voxel_layer": {
                "max_num_points": 32,
                "point_cloud_range": reach,
                "voxel_size": voxel,
                "max_voxels": (40000, 60000),
            },
        },
        "voxel_encoder": {
            "type": "PillarFeatureNet",
            "in_channels": 4,
            "feat_channels": [64],
            "with_distance": False,
            "voxel_size": voxel,
            "point_cloud_range": reach,
        },
        "middle_encoder": {
            "type": "PointPillarsScatter",
            "in_channels": 64,
            "output_shape": [rows, columns],
        },
        "backbone": {
            "type": "SECOND",
            "in_channels": 64,
            "layer_nums": [3, 5, 5],
            "layer_strides": [2, 2, 2],
            "out_channels": [64, 128, 256],
        },
        "neck": {
            "type": "SECONDFPN",
            "in_channels": [64, 128, 256],
            "upsample_strides": [1, 2, 4],
            "out_channels": [128, 128, 128],
        },
        "bbox_head": {
            "type": "Anchor3DHead",
            "num_classes": len(learned.classes),
            "in_channels": 384,
            "feat_channels": 384,
            "use_direction_classifier": True,
            "assign_per_class": True,
            "anchor_generator": {
                "type": "AlignedAnchor3DRangeGenerator",
                "ranges": [
                    [west, south, one.bottom_m, east, north, one.bottom_m]
                    for one in learned.classes
                ],
                "sizes": [list(one.size_m) for one in learned.classes],
                "rotations": [0, 1.57],
                "reshape_out": False,
            },
            "diff_rad_by_sin": True,
            "bbox_coder": {"type": "DeltaXYZWLHRBBoxCoder"},
            "loss_cls": {
                "type": "mmdet.FocalLoss",
                "use_sigmoid": True,
                "gamma": 2.0,
                "alpha": 0.25,
                "loss_weight": 1.0,
            },
            "loss_bbox": {"type": "mmdet.SmoothL1Loss", "beta": 1 / 9, "loss_weight": 2.0},
            "loss_dir": {
                "type": "mmdet.CrossEntropyLoss",
                "use_sigmoid": False,
                "loss_weight": 0.2,
            },
        },
        "train_cfg": {
            "assigner": [_assigner(one) for one in learned.classes],
            "allowed_border": 0,
            "pos_weight": -1,
            "debug": False,
        },
        "test_cfg": {
            "use_rotate_nms": True,
            "nms_across_levels": False,
            "nms_thr": 0.01,
            "score_thr": 0.1,
            "min_bbox_size": 0,
            "nms_pre": 1000,
            "max_num": 300,
        },
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
