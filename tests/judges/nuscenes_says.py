"""What nuscenes-devkit says of a folder: points, boxes, velocities, sweeps, labels to judge by."""

import json
import sys
from pathlib import Path

import numpy as np
from stand_ins import stand_in

stand_in("cv2", "sklearn", "matplotlib", "descartes")

from nuscenes.eval.common.config import config_factory  # noqa: E402
from nuscenes.eval.common.loaders import (  # noqa: E402
    add_center_dist,
    filter_eval_boxes,
    get_samples_of_custom_split,
    load_gt_of_sample_tokens,
)
from nuscenes.eval.detection.data_classes import DetectionBox  # noqa: E402
from nuscenes.nuscenes import NuScenes  # noqa: E402
from nuscenes.utils.data_classes import LidarPointCloud  # noqa: E402
from nuscenes.utils.data_io import load_bin_file, panoptic_to_lidarseg  # noqa: E402
from nuscenes.utils.splits import create_splits_scenes  # noqa: E402

root, out = Path(sys.argv[1]), Path(sys.argv[2])
nusc = NuScenes("v1.0-trainval", str(root), verbose=False)
named = {row["token"]: row["name"] for row in nusc.attribute}
levels = {row["token"]: row["level"] for row in nusc.visibility}
ours = create_splits_scenes()
scenes = []
for scene in nusc.scene:
    samples, token = [], scene["first_sample_token"]
    while token:
        sample = nusc.get("sample", token)
        assert sample["scene_token"] == scene["token"]
        lidar = sample["data"]["LIDAR_TOP"]
        path, boxes, _ = nusc.get_sample_data(lidar)
        cloud = LidarPointCloud.from_file(path)
        swept, lag = LidarPointCloud.from_file_multisweep(
            nusc, sample, "LIDAR_TOP", "LIDAR_TOP", nsweeps=3
        )
        name = Path(path).name.split(".")[0]
        labels = [
            load_bin_file(str(root / nusc.get(task, lidar)["filename"]), task)
            for task in ("lidarseg", "panoptic")
        ]
        np.savez(out / f"{name}.npz", points=cloud.points.T, swept=swept.points.T, lag=lag[0],
                 lidarseg=labels[0], panoptic=labels[1],
                 of_panoptic=panoptic_to_lidarseg(labels[1]))  # fmt: skip
        pose = nusc.get("ego_pose", nusc.get("sample_data", lidar)["ego_pose_token"])
        found = []
        for box in boxes:
            row = nusc.get("sample_annotation", box.token)
            velocity = nusc.box_velocity(box.token)
            found.append(
                {
                    "class": box.name,
                    "centre": box.center.tolist(),
                    "wlh": box.wlh.tolist(),
                    "axes": box.orientation.rotation_matrix.tolist(),
                    "site": row["translation"],
                    "velocity": None if np.isnan(velocity).any() else velocity.tolist(),
                    "points": row["num_lidar_pts"],
                    "attribute": [named[one] for one in row["attribute_tokens"]],
                    "visibility": levels[row["visibility_token"]],
                    "instance": row["instance_token"],
                }
            )
        samples.append(
            {
                "name": name, "time_us": sample["timestamp"], "boxes": found,
                "ego": [*pose["translation"], *pose["rotation"]],
            }
        )  # fmt: skip
        token = sample["next"]
    assert len(samples) == scene["nbr_samples"]
    parts = [part for part in ("train", "val", "test") if scene["name"] in ours[part]]
    scenes.append({"name": scene["name"], "parts": parts, "samples": samples})
for instance in nusc.instance:
    chain, token = 0, instance["first_annotation_token"]
    while token:
        row = nusc.get("sample_annotation", token)
        assert row["instance_token"] == instance["token"]
        chain, last, token = chain + 1, token, row["next"]
    assert (chain, last) == (instance["nbr_annotations"], instance["last_annotation_token"])
judged = {}
for split in json.loads((root / "v1.0-trainval" / "splits.json").read_text()):
    tokens = get_samples_of_custom_split(split, nusc)
    labels = add_center_dist(nusc, load_gt_of_sample_tokens(nusc, tokens, DetectionBox))
    loaded = len(labels.all)
    if loaded:
        labels = filter_eval_boxes(nusc, labels, config_factory("detection_cvpr_2019").class_range)
    judged[split] = {"samples": len(tokens), "loaded": loaded, "judged": len(labels.all)}
mask = nusc.map[0]["mask"]
rig = {}
for row in nusc.calibrated_sensor:
    channel = nusc.get("sensor", row["sensor_token"])["channel"]
    rig.setdefault(channel, []).append([*row["translation"], *row["rotation"]])
print(
    json.dumps(
        {"scenes": scenes, "judged": judged, "mask": list(mask.mask().shape), "rig": rig,
         "tables": sorted(nusc.table_names), "categories": nusc.lidarseg_idx2name_mapping}
    )
)  # fmt: skip
