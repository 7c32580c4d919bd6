"""Models of MMDetection3D for a dataset: PointPillars with anchors, and CenterPoint on pillars.

Source: MMDetection3D 1.4, ``configs/_base_/models/pointpillars_hv_secfpn_kitti.py`` and
``centerpoint_pillar02_second_secfpn_nus.py`` (Yin, Zhou and Kraehenbuehl 2021).
"""

from __future__ import annotations

from typing import Any

from urbantwin.exports.frames.learned_classes import PILLAR_M, LearnedClass, LearnedClasses

__all__ = ["centerpoint", "pointpillars"]

#: Cells of CenterPoint's map along an edge of a pillar.
_STRIDE = 4
#: How far beyond the range a middle may be told, metres.
_BEYOND_M = 5.0


def pointpillars(learned: LearnedClasses) -> dict[str, Any]:
    """Return PointPillars as Lang et al. 2019 have it, with one head."""
    west, south, _, east, north, _ = learned.range_m
    return {
        "type": "VoxelNet",
        "data_preprocessor": _preprocessor(learned),
        "voxel_encoder": _encoder(learned),
        "middle_encoder": _scatter(learned),
        "backbone": _backbone(),
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


def centerpoint(learned: LearnedClasses) -> dict[str, Any]:
    """Return CenterPoint on pillars, with a head for each class, which tells velocities, too."""
    reach = list(learned.range_m)
    edges = [PILLAR_M, PILLAR_M]
    limits = [
        *(round(one - _BEYOND_M, 2) for one in reach[:3]),
        *(round(one + _BEYOND_M, 2) for one in reach[3:]),
    ]
    norm = {"type": "BN", "eps": 1e-3, "momentum": 0.01}
    rows, columns = _grid(learned)
    return {
        "type": "CenterPoint",
        "data_preprocessor": _preprocessor(learned),
        "pts_voxel_encoder": _encoder(learned)
        | {"norm_cfg": {"type": "BN1d", "eps": 1e-3, "momentum": 0.01}, "legacy": False},
        "pts_middle_encoder": _scatter(learned),
        "pts_backbone": _backbone()
        | {"norm_cfg": norm, "conv_cfg": {"type": "Conv2d", "bias": False}},
        "pts_neck": {
            "type": "SECONDFPN",
            "in_channels": [64, 128, 256],
            "out_channels": [128, 128, 128],
            "upsample_strides": [0.5, 1, 2],
            "norm_cfg": norm,
            "upsample_cfg": {"type": "deconv", "bias": False},
            "use_conv_for_no_stride": True,
        },
        "pts_bbox_head": {
            "type": "CenterHead",
            "in_channels": 384,
            "tasks": [{"num_class": 1, "class_names": [name]} for name in learned.names],
            "common_heads": {
                "reg": (2, 2),
                "height": (1, 2),
                "dim": (3, 2),
                "rot": (2, 2),
                "vel": (2, 2),
            },
            "share_conv_channel": 64,
            "bbox_coder": {
                "type": "CenterPointBBoxCoder",
                "pc_range": reach[:2],
                "post_center_range": limits,
                "max_num": 500,
                "score_threshold": 0.1,
                "out_size_factor": _STRIDE,
                "voxel_size": edges,
                "code_size": 9,
            },
            "separate_head": {"type": "SeparateHead", "init_bias": -2.19, "final_kernel": 3},
            "loss_cls": {"type": "mmdet.GaussianFocalLoss", "reduction": "mean"},
            "loss_bbox": {"type": "mmdet.L1Loss", "reduction": "mean", "loss_weight": 0.25},
            "norm_bbox": True,
        },
        "train_cfg": {
            "pts": {
                "point_cloud_range": reach,
                "grid_size": [columns, rows, 1],
                "voxel_size": _voxel(learned),
                "out_size_factor": _STRIDE,
                "dense_reg": 1,
                "gaussian_overlap": 0.1,
                "max_objs": 500,
                "min_radius": 2,
                "code_weights": [1.0] * 8 + [0.2] * 2,
            }
        },
        "test_cfg": {
            "pts": {
                "pc_range": reach[:2],
                "post_center_limit_range": limits,
                "max_per_img": 500,
                "max_pool_nms": False,
                "min_radius": [1.0] * len(learned.names),
                "score_threshold": 0.1,
                "out_size_factor": _STRIDE,
                "voxel_size": edges,
                "nms_type": "rotate",
                "pre_max_size": 1000,
                "post_max_size": 83,
                "nms_thr": 0.2,
            }
        },
    }


def _voxel(learned: LearnedClasses) -> list[float]:
    return [PILLAR_M, PILLAR_M, round(learned.range_m[5] - learned.range_m[2], 1)]


def _grid(learned: LearnedClasses) -> tuple[int, int]:
    """Return how many pillars there are along y and along x."""
    west, south, _, east, north, _ = learned.range_m
    return round((north - south) / PILLAR_M), round((east - west) / PILLAR_M)


def _preprocessor(learned: LearnedClasses) -> dict[str, Any]:
    return {
        "type": "Det3DDataPreprocessor",
        "voxel": True,
        "voxel_layer": {
            "max_num_points": 32,
            "point_cloud_range": list(learned.range_m),
            "voxel_size": _voxel(learned),
            "max_voxels": (40000, 60000),
        },
    }


def _encoder(learned: LearnedClasses) -> dict[str, Any]:
    return {
        "type": "PillarFeatureNet",
        "in_channels": 4,
        "feat_channels": [64],
        "with_distance": False,
        "voxel_size": _voxel(learned),
        "point_cloud_range": list(learned.range_m),
    }


def _scatter(learned: LearnedClasses) -> dict[str, Any]:
    return {
        "type": "PointPillarsScatter",
        "in_channels": 64,
        "output_shape": list(_grid(learned)),
    }


def _backbone() -> dict[str, Any]:
    return {
        "type": "SECOND",
        "in_channels": 64,
        "layer_nums": [3, 5, 5],
        "layer_strides": [2, 2, 2],
        "out_channels": [64, 128, 256],
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
