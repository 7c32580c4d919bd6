"""OpenPCDet's custom dataset, ready to train: what its own ``create_custom_infos`` makes, made.

Sources: OpenPCDet, ``docs/CUSTOM_DATASET_TUTORIAL.md`` and
``pcdet/datasets/custom/custom_dataset.py`` (``get_infos``, ``create_groundtruth_database``). Two
things differ from what that file would make: a frame without boxes has none (it fails at an empty
text), and names have room for KITTI's, which its evaluation writes over them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from urbantwin.artefact import check_file, replaced_file
from urbantwin.dataset.reading.columns import POINT
from urbantwin.dataset.reading.frame_files import stored_frames
from urbantwin.exports.frames.learned_boxes import LearnedBoxes, ObjectDatabase, learned_boxes
from urbantwin.exports.frames.learned_classes import (
    FEWEST_POINTS,
    PILLAR_M,
    LearnedClass,
    LearnedClasses,
    learned_classes,
)
from urbantwin.exports.frames.plain_pickle import write_plain_pickle
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.frames.trainer_folder import left_out, write_configs, write_splits
from urbantwin.progress import Progress
from urbantwin.taxonomy import classes_in

__all__ = ["losses_openpcdet", "write_openpcdet", "write_openpcdet_config"]


#: OpenPCDet leaves out boxes of this name where it trains, and judges none by them.
DONT_CARE = "DontCare"
_TURNED = {"NAME": "random_world_rotation", "WORLD_ROT_ANGLE": [-3.14159, 3.14159]}
_FILTERS = [64, 128, 256]
_RECALLS = [0.3, 0.5, 0.7]


def openpcdet_config(learned: LearnedClasses, data_path: str, model: str = "pointpillar") -> str:
    """Return a config as YAML.

    Args:
        learned: the classes, and where they are.
        data_path: of the dataset, as OpenPCDet's programs find it.
        model: one of `CONFIGS`.
    """
    config = {
        "CLASS_NAMES": learned.names,
        "DATA_CONFIG": _data(learned, data_path),
        "MODEL": CONFIGS[model](learned),
        "OPTIMIZATION": {
            "BATCH_SIZE_PER_GPU": 4,
            "NUM_EPOCHS": 80,
            "OPTIMIZER": "adam_onecycle",
            "LR": 0.003,
            "WEIGHT_DECAY": 0.01,
            "MOMENTUM": 0.9,
            "MOMS": [0.95, 0.85],
            "PCT_START": 0.4,
            "DIV_FACTOR": 10,
            "DECAY_STEP_LIST": [35, 45],
            "LR_DECAY": 0.1,
            "LR_CLIP": 1.0e-7,
            "LR_WARMUP": False,
            "WARMUP_EPOCH": 1,
            "GRAD_NORM_CLIP": 10,
        },
    }
    return yaml.safe_dump(config, sort_keys=False, width=100)


def _data(learned: LearnedClasses, data_path: str) -> dict[str, Any]:
    low, high = learned.range_m[2], learned.range_m[5]
    # Its evaluation looks up every labelled name. What is not learned counts neither as found
    # nor as missed.
    in_kitti = {
        name: _evaluated_as(name) if name in learned.names else DONT_CARE
        for name in dict.fromkeys((*learned.names, *learned.labelled))
    }
    return {
        "DATASET": "CustomDataset",
        "DATA_PATH": data_path,
        "POINT_CLOUD_RANGE": list(learned.range_m),
        "MAP_CLASS_TO_KITTI": in_kitti | {DONT_CARE: DONT_CARE},
        "DATA_SPLIT": {"train": "train", "test": "val"},
        "INFO_PATH": {"train": ["custom_infos_train.pkl"], "test": ["custom_infos_val.pkl"]},
        "POINT_FEATURE_ENCODING": {
            "encoding_type": "absolute_coordinates_encoding",
            "used_feature_list": list(POINT),
            "src_feature_list": list(POINT),
        },
        "DATA_AUGMENTOR": {
            "DISABLE_AUG_LIST": [],
            "AUG_CONFIG_LIST": [
                {
                    "NAME": "gt_sampling",
                    "USE_ROAD_PLANE": False,
                    "DB_INFO_PATH": ["custom_dbinfos_train.pkl"],
                    "PREPARE": {
                        "filter_by_min_points": [
                            f"{name}:{FEWEST_POINTS}" for name in learned.names
                        ]
                    },
                    "SAMPLE_GROUPS": [f"{one.name}:{one.sampled}" for one in learned.classes],
                    "NUM_POINT_FEATURES": len(POINT),
                    "DATABASE_WITH_FAKELIDAR": False,
                    "REMOVE_EXTRA_WIDTH": [0.0, 0.0, 0.0],
                    "LIMIT_WHOLE_SCENE": True,
                },
                {"NAME": "random_world_flip", "ALONG_AXIS_LIST": ["x", "y"]},
                _TURNED,
                {"NAME": "random_world_scaling", "WORLD_SCALE_RANGE": [0.95, 1.05]},
            ],
        },
        "DATA_PROCESSOR": [
            {"NAME": "mask_points_and_boxes_outside_range", "REMOVE_OUTSIDE_BOXES": True},
            {"NAME": "shuffle_points", "SHUFFLE_ENABLED": {"train": True, "test": False}},
            {
                "NAME": "transform_points_to_voxels",
                "VOXEL_SIZE": [PILLAR_M, PILLAR_M, round(high - low, 1)],
                "MAX_POINTS_PER_VOXEL": 32,
                "MAX_NUMBER_OF_VOXELS": {"train": 40000, "test": 60000},
            },
        ],
    }


def _evaluated_as(name: str) -> str:
    """Return what KITTI calls a class among those that its evaluation knows."""
    called = classes_in("kitti").get(name)
    return DONT_CARE if called in (None, "Misc") else "Truck" if called == "Tram" else str(called)


def _backbone(strides: list[int]) -> dict[str, Any]:
    return {
        "NAME": "BaseBEVBackbone",
        "LAYER_NUMS": [3, 5, 5],
        "LAYER_STRIDES": strides,
        "NUM_FILTERS": _FILTERS,
        "UPSAMPLE_STRIDES": [1, 2, 4],
        "NUM_UPSAMPLE_FILTERS": [128, 128, 128],
    }


def _pillars(name: str, filters: list[int], strides: list[int]) -> dict[str, Any]:
    return {
        "NAME": name,
        "VFE": {
            "NAME": "PillarVFE",
            "WITH_DISTANCE": False,
            "USE_ABSLOTE_XYZ": True,  # so it is spelled there
            "USE_NORM": True,
            "NUM_FILTERS": filters,
        },
        "MAP_TO_BEV": {"NAME": "PointPillarScatter", "NUM_BEV_FEATURES": 64},
        "BACKBONE_2D": _backbone(strides),
    }


def _suppression(threshold: float) -> dict[str, Any]:
    return {
        "NMS_TYPE": "nms_gpu",
        "NMS_THRESH": threshold,
        "NMS_PRE_MAXSIZE": 4096,
        "NMS_POST_MAXSIZE": 500,
    }


def _anchor(one: LearnedClass) -> dict[str, Any]:
    return {
        "class_name": one.name,
        "anchor_sizes": [list(one.size_m)],
        "anchor_rotations": [0, 1.57],
        "anchor_bottom_heights": [one.bottom_m],
        "align_center": False,
        "feature_map_stride": 2,
        "matched_threshold": one.matched,
        "unmatched_threshold": one.unmatched,
    }


def _pointpillar(learned: LearnedClasses) -> dict[str, Any]:
    """Return PointPillars as Lang et al. 2019 have it, with one head."""
    return {
        **_pillars("PointPillar", [64], [2, 2, 2]),
        "DENSE_HEAD": {
            "NAME": "AnchorHeadSingle",
            "CLASS_AGNOSTIC": False,
            "USE_DIRECTION_CLASSIFIER": True,
            "DIR_OFFSET": 0.78539,
            "DIR_LIMIT_OFFSET": 0.0,
            "NUM_DIR_BINS": 2,
            "ANCHOR_GENERATOR_CONFIG": [_anchor(one) for one in learned.classes],
            "TARGET_ASSIGNER_CONFIG": {
                "NAME": "AxisAlignedTargetAssigner",
                "POS_FRACTION": -1.0,
                "SAMPLE_SIZE": 512,
                "NORM_BY_NUM_EXAMPLES": False,
                "MATCH_HEIGHT": False,
                "BOX_CODER": "ResidualCoder",
            },
            "LOSS_CONFIG": {
                "LOSS_WEIGHTS": {
                    "cls_weight": 1.0,
                    "loc_weight": 2.0,
                    "dir_weight": 0.2,
                    "code_weights": [1.0] * 7,
                }
            },
        },
        "POST_PROCESSING": {
            "RECALL_THRESH_LIST": _RECALLS,
            "SCORE_THRESH": 0.1,
            "OUTPUT_RAW_SCORE": False,
            "EVAL_METRIC": "kitti",
            "NMS_CONFIG": {"MULTI_CLASSES_NMS": False, **_suppression(0.01)},
        },
    }


def _centerpoint(learned: LearnedClasses) -> dict[str, Any]:
    """Return CenterPoint on pillars, with one head for all classes."""
    low, high = learned.range_m[:3], learned.range_m[3:]
    channels = {"center": 2, "center_z": 1, "dim": 3, "rot": 2}
    return {
        **_pillars("CenterPoint", [64, 64], [2, 2, 2]),
        "DENSE_HEAD": {
            "NAME": "CenterHead",
            "CLASS_AGNOSTIC": False,
            "CLASS_NAMES_EACH_HEAD": [learned.names],
            "SHARED_CONV_CHANNEL": 64,
            "USE_BIAS_BEFORE_NORM": True,
            "NUM_HM_CONV": 2,
            "SEPARATE_HEAD_CFG": {
                "HEAD_ORDER": list(channels),
                "HEAD_DICT": {
                    name: {"out_channels": count, "num_conv": 2} for name, count in channels.items()
                },
            },
            "TARGET_ASSIGNER_CONFIG": {
                "FEATURE_MAP_STRIDE": 2,
                "NUM_MAX_OBJS": 500,
                "GAUSSIAN_OVERLAP": 0.1,
                "MIN_RADIUS": 2,
            },
            "LOSS_CONFIG": {
                "LOSS_WEIGHTS": {"cls_weight": 1.0, "loc_weight": 2.0, "code_weights": [1.0] * 8}
            },
            "POST_PROCESSING": {
                "SCORE_THRESH": 0.1,
                "POST_CENTER_LIMIT_RANGE": [
                    *(round(one - 5, 2) for one in low),
                    *(round(one + 5, 2) for one in high),
                ],
                "MAX_OBJ_PER_SAMPLE": 500,
                "NMS_CONFIG": _suppression(0.2),
            },
        },
        "POST_PROCESSING": {"RECALL_THRESH_LIST": _RECALLS, "EVAL_METRIC": "kitti"},
    }


#: The models that there are configs for; a config's file is named so.
CONFIGS: Mapping[str, Callable[[LearnedClasses], dict[str, Any]]] = {
    "pointpillar": _pointpillar,
    "centerpoint": _centerpoint,
}


#: Where OpenPCDet's own configs look, from its folder ``tools``.
_DATA_PATH = "../data/custom"
_COMMAND = """# In OpenPCDet's folder tools, with this folder at FOLDER:
# python train.py --cfg_file FOLDER/{}.yaml --set DATA_CONFIG.DATA_PATH FOLDER
"""
_FEATURES = 4


def losses_openpcdet(source: FrameSource) -> list[str]:
    """Return what is lost besides what the format cannot hold."""
    return left_out(source, f"{DONT_CARE}, which OpenPCDet neither learns nor judges by")


def write_openpcdet(source: FrameSource, folder: Path, tell: Progress) -> Sequence[str]:
    """Write a dataset as OpenPCDet's custom dataset, with the configs to train on it.

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
    """Write a config to train PointPillars on a dataset as it is, with OpenPCDet.

    Args:
        dataset: one of ours.
        file: to write.

    Returns:
        What a person should be told.

    Raises:
        InputError: it is no dataset of ours, or no class has enough boxes.
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
