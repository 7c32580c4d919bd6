"""What nuScenes' and Argoverse 2's development kits say of detections, by their metrics alone.

Reads frames of boxes (x, y, z, length, width, height, yaw and, of a detected one, its score) as
JSON: those labelled, those detected, and those `found` that errors are asked of. Modules for maps
and files that the kits import beside are stood in for.
"""

import json
import sys

import numpy as np
from stand_ins import stand_in

NAME = "car"

stand_in("cv2", "descartes", "joblib", "matplotlib", "pandas", "polars", "shapely", "sklearn")
stand_in("upath", "av2.map", "av2.structures", "av2.utils.io", "nuscenes.lidarseg")
stand_in("nuscenes.panoptic", "nuscenes.nuscenes")

from av2.evaluation.detection.utils import DetectionCfg  # noqa: E402
from av2.evaluation.detection.utils import accumulate as av2_accumulate  # noqa: E402
from nuscenes.eval.common.data_classes import EvalBoxes  # noqa: E402
from nuscenes.eval.common.utils import center_distance, scale_iou, yaw_diff  # noqa: E402
from nuscenes.eval.detection.algo import accumulate, calc_ap  # noqa: E402
from nuscenes.eval.detection.data_classes import DetectionBox  # noqa: E402
from pyquaternion import Quaternion  # noqa: E402

DISTANCES_M = (0.5, 1.0, 2.0, 4.0)


def nuscenes_boxes(frames, key):
    boxes = EvalBoxes()
    for number, frame in enumerate(frames):
        boxes.add_boxes(
            str(number),
            [
                DetectionBox(
                    sample_token=str(number),
                    translation=tuple(box[:3]),
                    size=(box[4], box[3], box[5]),
                    rotation=tuple(Quaternion(axis=[0, 0, 1], radians=box[6]).elements),
                    velocity=(0.0, 0.0),
                    num_pts=9,
                    detection_name=NAME,
                    detection_score=box[7] if len(box) > 7 else -1.0,
                    attribute_name="",
                )
                for box in frame[key]
            ],
        )
    return boxes


def nuscenes_figures(frames):
    labelled, detected = (nuscenes_boxes(frames, key) for key in ("labelled", "detected"))
    return {
        f"within_{distance:g}_m": calc_ap(
            accumulate(labelled, detected, NAME, center_distance, distance), 0.1, 0.1
        )
        for distance in DISTANCES_M
    }


def nuscenes_errors(frames):
    """The kit's own errors of the pairs within 2 m, where nobody stands near to two."""
    labelled, found = (nuscenes_boxes(frames, key) for key in ("labelled", "found"))
    rows = []
    for number in range(len(frames)):
        for one in found[str(number)]:
            true = min(labelled[str(number)], key=lambda box, one=one: center_distance(box, one))
            if center_distance(true, one) < 2:
                rows.append([center_distance(true, one), 1 - scale_iou(true, one),
                             yaw_diff(true, one, period=2 * np.pi)])  # fmt: skip
    return dict(zip(("ate_m", "ase", "aoe_rad"), np.mean(rows, axis=0).tolist(), strict=True))


def argoverse_rows(boxes):
    rows = np.array(boxes, float).reshape(len(boxes), -1)
    half = rows[:, 6] / 2
    zero = np.zeros(len(rows))
    last = rows[:, 7] if rows.shape[1] > 7 else np.full(len(rows), 9.0)
    return np.column_stack([rows[:, :6], np.cos(half), zero, zero, np.sin(half), last])


def argoverse_figures(frames):
    config = DetectionCfg(categories=(NAME,), eval_only_roi_instances=False, max_range_m=1e6)
    found = []
    for frame in frames:
        if frame["labelled"] and frame["found"]:
            detected, _ = av2_accumulate(
                argoverse_rows(frame["found"]), argoverse_rows(frame["labelled"]), config
            )
            found.append(detected)
    table = np.concatenate(found)
    right = table[:, DISTANCES_M.index(config.tp_threshold_m)] > 0
    ate, ase, aoe = table[right, 4:7].mean(axis=0).tolist()
    hits = {
        f"within_{distance:g}_m": int(table[:, k].sum()) for k, distance in enumerate(DISTANCES_M)
    }
    return {"hits": hits, "ate_m": ate, "ase": ase, "aoe_rad": aoe}


scenes = json.load(sys.stdin)
print(
    json.dumps(
        [
            {
                "nuscenes": nuscenes_figures(one),
                "nuscenes_errors": nuscenes_errors(one),
                "argoverse": argoverse_figures(one),
            }
            for one in scenes
        ]
    )
)
