"""What Vicomtech's VCD says of OpenLABEL files, after ASAM's schema: objects, their data."""

import json
import sys
from pathlib import Path

from stand_ins import stand_in

stand_in("cv2")

from vcd.core import OpenLABEL  # noqa: E402

found = {}
for path in map(Path, json.load(sys.stdin)):
    read = OpenLABEL()
    read.load_from_file(str(path), validation=True)
    root = read.get_root()
    (number, frame), *others = root["frames"].items()
    assert not others
    objects = {}
    for identity in read.get_objects() or {}:
        cuboid = read.get_object_data(identity, "shape3D", int(number))
        known = {one["name"]: one["val"] for kind in cuboid["attributes"].values() for one in kind}
        objects[identity] = {
            "class": read.get_object(identity)["type"],
            "system": cuboid["coordinate_system"],
            "val": cuboid["val"],
            **{"attributes": known},
        }
    found[path.stem] = {
        "number": int(number),
        "time_s": frame["frame_properties"]["timestamp"],
        "cloud": frame["frame_properties"]["point_cloud_file_name"],
        "transforms": frame["frame_properties"]["transforms"],
        "systems": read.get_coordinate_systems(),
        "objects": objects,
    }
print(json.dumps(found))
