"""Run by the judges' own Python: LAZ files as LASzip reads them, the library that made the format.

UrbanTwin itself writes and reads them by lazrs, which is another program.
"""

import json
import sys
from pathlib import Path

import laspy
import numpy as np


def told(path):
    """Every value of a file, as JSON holds it."""
    cloud = laspy.read(path, laz_backend=laspy.LazBackend.Laszip)
    names = ("intensity", "gps_time", "classification", "return_number", "number_of_returns")
    names += tuple(cloud.point_format.extra_dimension_names)
    values = {axis: np.asarray(getattr(cloud, axis)).tolist() for axis in "xyz"}
    return values | {name: np.asarray(cloud[name]).tolist() for name in names}


print(json.dumps([told(Path(one)) for one in sys.argv[1:]]))
