"""What plyfile, with which the LUMPI SDK reads clouds, finds in PLY files: written as .npz."""

import json
import sys
from pathlib import Path

import numpy as np
from plyfile import PlyData

for source, target in json.load(sys.stdin):
    vertex = PlyData.read(source)["vertex"]
    np.savez(Path(target), **{one.name: np.array(vertex[one.name]) for one in vertex.properties})
print(json.dumps(True))
