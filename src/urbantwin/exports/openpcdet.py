"""A config of OpenPCDet for a dataset: its classes, its range, and anchors that are its medians.

Source: OpenPCDet's configs of PointPillars (Lang et al. 2019) and of its custom dataset.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from urbantwin.artefact import replaced_file
from urbantwin.artefact.document import read_bytes
from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset.frame_files import stored_frames
from urbantwin.errors import InputError

__all__ = ["write_openpcdet"]

_EXPECTED = "a dataset of urbantwin record"
_COLUMNS = {
    "frame": "text",
    "class": "text", **dict.fromkeys(("x", "y", "z", "length", "width", "height"), "number"),
    "num_points": "whole",
}  # fmt: skip
#: Boxes with fewer points are no example; of a class with fewer boxes nothing is learned.
_FEWEST_POINTS, _FEWEST_BOXES = 5, 10
#: Edge of a pillar, metres; so many of them along an edge are a multiple of this (strides 2, 2, 2).
_PILLAR_M, _MULTIPLE = 0.16, 16
#: The range holds this share of the middles of boxes, and so much more on every side, metres.
_HELD, _MARGIN_M = 0.99, 2.0
#: KITTI's name of each class, by which OpenPCDet evaluates.
_IN_KITTI = {
    "car": "Car", "van": "Van", "truck": "Truck", "trailer": "Truck", "bus": "Truck",
    "tram": "Truck", "motorcycle": "Cyclist", "bicycle": "Cyclist", "pedestrian": "Pedestrian",
}  # fmt: skip
#: Overlap with an anchor from which on, and up to which, it is of the class or not.
_LARGE, _SMALL = (0.6, 0.45), (0.5, 0.35)
_MOST_SAMPLED = 15


def write_openpcdet(dataset: Path, file: Path) -> list[str]:
    """Write a config to train PointPillars on a dataset with OpenPCDet.

    Args:
        dataset: one of ours.
        file: to write.

    Returns:
        What a person should be told.

    Raises:
        InputError: it is no dataset of ours, or no class has enough boxes.
    """
    table = dataset / "boxes.parquet"
    boxes = columns_of(
        read_parquet(table, _EXPECTED, columns=list(_COLUMNS)), _COLUMNS, table, _EXPECTED
    )
    # Its evaluation looks every labelled name up, also of classes that are not learned.
    labelled = sorted(set(boxes["class"].astype(str).tolist()))
    split = dataset / "ImageSets" / "train.txt"
    training = read_bytes(split, _EXPECTED).decode(errors="replace").split()
    seen = (boxes["num_points"] >= _FEWEST_POINTS) & np.isin(boxes["frame"].astype(str), training)
    boxes = {name: column[seen] for name, column in boxes.items()}
    names, counts = np.unique(boxes["class"].astype(str), return_counts=True)
    known = dict(zip(names.tolist(), counts.tolist(), strict=True))
    classes = [name for name in _IN_KITTI if known.get(name, 0) >= _FEWEST_BOXES]
    if not classes:
        raise InputError(
            f"has no class with {_FEWEST_BOXES} boxes of {_FEWEST_POINTS} points",
            file=table,
            expected="labelled road users",
        )
    config = _config(dataset, boxes, classes, {name: known[name] for name in classes})
    others = {name: _IN_KITTI.get(name, "DontCare") for name in labelled}
    config["DATA_CONFIG"]["MAP_CLASS_TO_KITTI"] |= others
    with replaced_file(file, inputs=[dataset]) as passing:
        passing.write_text(yaml.safe_dump(config, sort_keys=False, width=100))
    few = sorted(set(known) - set(classes))
    notes = [f"left out: {known[name]} boxes of {name}" for name in few]
    if stored_frames(dataset):
        notes.append("OpenPCDet reads points/*.npy, and these are kept in columns")
    side = config["DATA_CONFIG"]["POINT_CLOUD_RANGE"][3]
    return [*notes, f"looks {side:g} m along x and y; DATA_PATH is {dataset}"]


def _range(boxes: Mapping[str, NDArray[Any]]) -> list[float]:
    """Return the least and greatest x, y, z: square, as many pillars as strides divide."""
    far = np.quantile(np.maximum(np.abs(boxes["x"]), np.abs(boxes["y"])), _HELD) + _MARGIN_M
    step = _PILLAR_M * _MULTIPLE / 2
    side = round(float(np.ceil(far / step) * step), 2)
    low = np.quantile(boxes["z"] - boxes["height"] / 2, (1 - _HELD) / 2) - _MARGIN_M / 4
    high = np.quantile(boxes["z"] + boxes["height"] / 2, (1 + _HELD) / 2) + _MARGIN_M / 4
    low, high = np.floor(10 * low) / 10, np.ceil(10 * high) / 10
    return [-side, -side, round(float(low), 1), side, side, round(float(high), 1)]


def _anchor(name: str, boxes: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    mine = boxes["class"] == name
    size = [round(float(np.median(boxes[one][mine])), 2) for one in ("length", "width", "height")]
    bottom = float(np.median((boxes["z"] - boxes["height"] / 2)[mine]))
    matched, unmatched = _SMALL if size[1] < 1.2 else _LARGE
    return {
        "class_name": name,
        "anchor_sizes": [size],
        "anchor_rotations": [0, 1.57],
        "anchor_bottom_heights": [round(bottom, 2)],
        "align_center": False,
        "feature_map_stride": 2,
        "matched_threshold": matched,
        "unmatched_threshold": unmatched,
    }


def _config(
    dataset: Path,
    boxes: Mapping[str, NDArray[Any]],
    classes: list[str],
    counts: Mapping[str, int],
) -> dict[str, Any]:
    reach = _range(boxes)
    features = ["x", "y", "z", "intensity"]
    # Whoever is frequent need not be pasted in as often.
    most = max(counts.values())
    sampled = [f"{name}:{max(2, round(_MOST_SAMPLED * (1 - counts[name] / most / 2)))}"
               for name in classes]  # fmt: skip
    data = {
        "DATASET": "CustomDataset",
        "DATA_PATH": str(dataset.resolve()),
        "POINT_CLOUD_RANGE": reach,
        "MAP_CLASS_TO_KITTI": {name: _IN_KITTI[name] for name in classes},
        "DATA_SPLIT": {"train": "train", "test": "val"},
        "INFO_PATH": {"train": ["custom_infos_train.pkl"], "test": ["custom_infos_val.pkl"]},
        "POINT_FEATURE_ENCODING": {
            "encoding_type": "absolute_coordinates_encoding",
            "used_feature_list": features,
            "src_feature_list": features,
        },
        "DATA_AUGMENTOR": {
            "DISABLE_AUG_LIST": [],
            "AUG_CONFIG_LIST": [
                {
                    "NAME": "gt_sampling",
                    "USE_ROAD_PLANE": False,
                    "DB_INFO_PATH": ["custom_dbinfos_train.pkl"],
                    "PREPARE": {
                        "filter_by_min_points": [f"{name}:{_FEWEST_POINTS}" for name in classes]
                    },
                    "SAMPLE_GROUPS": sampled,
                    "NUM_POINT_FEATURES": len(features),
                    "DATABASE_WITH_FAKELIDAR": False,
                    "REMOVE_EXTRA_WIDTH": [0.0, 0.0, 0.0],
                    "LIMIT_WHOLE_SCENE": True,
                },
                {"NAME": "random_world_flip", "ALONG_AXIS_LIST": ["x", "y"]},
                {"NAME": "random_world_rotation", "WORLD_ROT_ANGLE": [-3.14159, 3.14159]},
                {"NAME": "random_world_scaling", "WORLD_SCALE_RANGE": [0.95, 1.05]},
            ],
        },
        "DATA_PROCESSOR": [
            {"NAME": "mask_points_and_boxes_outside_range", "REMOVE_OUTSIDE_BOXES": True},
            {"NAME": "shuffle_points", "SHUFFLE_ENABLED": {"train": True, "test": False}},
            {
                "NAME": "transform_points_to_voxels",
                "VOXEL_SIZE": [_PILLAR_M, _PILLAR_M, round(reach[5] - reach[2], 1)],
                "MAX_POINTS_PER_VOXEL": 32,
                "MAX_NUMBER_OF_VOXELS": {"train": 40000, "test": 60000},
            },
        ],
    }
    return {
        "CLASS_NAMES": classes,
        "DATA_CONFIG": data,
        "MODEL": _model([_anchor(name, boxes) for name in classes]),
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


def _model(anchors: list[dict[str, Any]]) -> dict[str, Any]:
    """Return PointPillars as Lang et al. 2019 have it, with one head."""
    return {
        "NAME": "PointPillar",
        "VFE": {
            "NAME": "PillarVFE",
            "WITH_DISTANCE": False,
            "USE_ABSLOTE_XYZ": True,  # so it is spelled there
            "USE_NORM": True,
            "NUM_FILTERS": [64],
        },
        "MAP_TO_BEV": {"NAME": "PointPillarScatter", "NUM_BEV_FEATURES": 64},
        "BACKBONE_2D": {
            "NAME": "BaseBEVBackbone",
            "LAYER_NUMS": [3, 5, 5],
            "LAYER_STRIDES": [2, 2, 2],
            "NUM_FILTERS": [64, 128, 256],
            "UPSAMPLE_STRIDES": [1, 2, 4],
            "NUM_UPSAMPLE_FILTERS": [128, 128, 128],
        },
        "DENSE_HEAD": {
            "NAME": "AnchorHeadSingle",
            "CLASS_AGNOSTIC": False,
            "USE_DIRECTION_CLASSIFIER": True,
            "DIR_OFFSET": 0.78539,
            "DIR_LIMIT_OFFSET": 0.0,
            "NUM_DIR_BINS": 2,
            "ANCHOR_GENERATOR_CONFIG": anchors,
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
            "RECALL_THRESH_LIST": [0.3, 0.5, 0.7],
            "SCORE_THRESH": 0.1,
            "OUTPUT_RAW_SCORE": False,
            "EVAL_METRIC": "kitti",
            "NMS_CONFIG": {
                "MULTI_CLASSES_NMS": False,
                "NMS_TYPE": "nms_gpu",
                "NMS_THRESH": 0.01,
                "NMS_PRE_MAXSIZE": 4096,
                "NMS_POST_MAXSIZE": 500,
            },
        },
    }
