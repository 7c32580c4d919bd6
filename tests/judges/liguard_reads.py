"""What LiGuard's own readers find in a folder: points, calibrations and labels of every frame.

Open3D, which LiGuard asks for, reads its .ply and .pcd files only: it is not needed here.
"""

import hashlib
import json
import sys
import types

sys.modules["open3d"] = types.ModuleType("open3d")

from liguard.calib.file_io import FileIO as Calibrations  # noqa: E402
from liguard.lbl.file_io import FileIO as Labels  # noqa: E402
from liguard.pcd.file_io import FileIO as Clouds  # noqa: E402

job = json.load(sys.stdin)
settings = {
    "data": {
        "main_dir": job["folder"],
        "pipeline_dir": job["folder"],
        "count": job["count"],
        "start": {"lidar": 0, "calib": 0, "label": 0, "global_zero": 0},
        "lidar_subdir": job["clouds"],
        "lidar": {"pcd_type": job["ending"]},
        "label_subdir": job["labels"],
        "label": {"lbl_type": job["kind"]},
        "calib_subdir": job.get("calibrations"),
        "calib": {"clb_type": job["kind"]},
    },
    "threads": {"io_sleep": 0},
}
clouds = Clouds(settings)
calibrations = Calibrations(settings) if job.get("calibrations") else None
labels = Labels(settings, calibrations.__getitem__ if calibrations else None)
frames = []
for number in range(len(clouds)):
    _, points = clouds[number]
    _, found = labels[number]
    frames.append(
        {
            "shape": list(points.shape),
            "sha256": hashlib.sha256(points.astype("<f4").tobytes()).hexdigest(),
            "labels": [
                {
                    "class": one["class"],
                    "centre": [float(value) for value in one["bbox_3d"]["xyz_center"]],
                    "extent": [float(value) for value in one["bbox_3d"]["xyz_extent"]],
                    "turn": float(one["bbox_3d"]["xyz_euler_angles"][2]),
                }
                for one in found
            ],
        }
    )
for reader in (clouds, calibrations, labels):
    if reader is not None:
        reader.close()
print(json.dumps(frames))
