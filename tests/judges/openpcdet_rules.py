"""What OpenPCDet makes of an exported folder, told from its rules alone, with NumPy 1.

OpenPCDet is not on PyPI and its operations need CUDA. The rules are those of
``pcdet/datasets/custom/custom_dataset.py`` (``get_label``, ``get_lidar``, ``get_infos``,
``create_groundtruth_database``, ``__getitem__``), ``pcdet/ops/roiaware_pool3d``
(``check_pt_in_box3d_cpu``), ``pcdet/datasets/augmentor/database_sampler.py`` and
``pcdet/datasets/kitti/kitti_utils.py`` (``transform_annotations_to_kitti_format``).
"""

import copy
import json
import math
import pickle
import sys
from pathlib import Path

import numpy as np

folder = Path(sys.argv[1])
job = json.load(sys.stdin)
wrong = []
answer = {"numpy": np.__version__, "wrong": wrong, "learned": {}, "objects": {}, "trained": {}}


def load(name):
    with (folder / name).open("rb") as stream:
        return pickle.load(stream)


def expect(right, what):
    if not right:
        wrong.append(what)


def labelled(name):
    """Every word but the last of a line is the box; the last is the class."""
    words = [line.strip().split(" ") for line in (folder / "labels" / f"{name}.txt").open()]
    box = np.array([one[:-1] for one in words], np.float32).reshape(-1, 7)
    return box, [one[-1] for one in words]


def inside(points, box):
    """A centimetre is added in plan, nothing in height."""
    found = []
    c, s = math.cos(-box[6]), math.sin(-box[6])
    for number, (x, y, z) in enumerate(points[:, :3].tolist()):
        if abs(z - box[2]) > box[5] / 2:
            continue
        u, v = x - box[0], y - box[1]
        if abs(u * c - v * s) < box[3] / 2 + 0.01 and abs(u * s + v * c) < box[4] / 2 + 0.01:
            found.append(number)
    return found


database = load("custom_dbinfos_train.pkl")
expected = {}
for part in ("train", "val"):
    names = [line.strip() for line in (folder / "ImageSets" / f"{part}.txt").open()]
    infos = load(f"custom_infos_{part}.pkl")
    expect([one["point_cloud"]["lidar_idx"] for one in infos] == names, f"{part}: order")
    answer["learned"][part] = {}
    for info in infos:
        name = info["point_cloud"]["lidar_idx"]
        expect(info["point_cloud"]["num_features"] == 4, f"{name}: features")
        points = np.load(folder / "points" / f"{name}.npy")
        expect(points.shape[1:] == (4,) and points.dtype == np.float32, f"{name}: points")
        box, classes = labelled(name)
        told = info["annos"]
        expect(told["gt_boxes_lidar"].dtype == np.float32, f"{name}: type of boxes")
        expect(np.array_equal(told["gt_boxes_lidar"], box), f"{name}: boxes")
        expect(told["name"].tolist() == classes, f"{name}: classes")

        # Training: what is DontCare is dropped, every array by the same rows.
        kept = [row for row, one in enumerate(told["name"]) if one != "DontCare"]
        gt_names, gt_boxes = told["name"][kept], told["gt_boxes_lidar"][kept]
        for one, its_box in zip(gt_names, gt_boxes, strict=True):
            answer["learned"][part].setdefault(str(one), []).append(
                [name, *[float(value) for value in its_box]]
            )

        # Evaluation: KITTI's names are written over the names.
        annos = copy.deepcopy(told)
        for row, one in enumerate(told["name"]):
            annos["name"][row] = job["map"][str(one)]
        expect(annos["name"].tolist() == [job["map"][one] for one in classes], f"{name}: cut")

        if part == "train":
            for row, (its_box, one) in enumerate(zip(box, classes, strict=True)):
                chosen = inside(points, its_box.tolist())
                own = points[chosen].copy()
                own[:, :3] -= its_box[:3]
                expected.setdefault(one, []).append((f"{name}_{one}_{row}.bin", own, its_box, row))

expect(sorted(database) == sorted(expected), "classes of the database")
files = {one.name for one in (folder / "gt_database").iterdir()}
expect(files == {one[0] for rows in expected.values() for one in rows}, "files of the database")
for one, rows in expected.items():
    expect(len(rows) == len(database[one]), f"{one}: how many objects")
    for (file, own, its_box, row), info in zip(rows, database[one], strict=True):
        expect(info["path"] == f"gt_database/{file}", f"{file}: path")
        expect(info["name"] == one and info["gt_idx"] == row, f"{file}: name")
        expect(np.array_equal(info["box3d_lidar"], its_box), f"{file}: box")
        read = np.fromfile(folder / info["path"], np.float32).reshape(-1, 4)
        expect(info["num_points_in_gt"] == len(read), f"{file}: its number of points")
        expect(np.array_equal(read, own), f"{file}: points")
    answer["objects"][one] = len(rows)

# The sampler: a class that is learned must be there, and have something left.
for one in job["classes"]:
    enough = [info for info in database[one] if info["num_points_in_gt"] >= job["fewest"]]
    answer["trained"][one] = len(enough)
print(json.dumps(answer))
