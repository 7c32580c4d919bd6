"""What hydra4 reads from packets of a PandarXT-32 or an OT128: x to the right, y forward, z up.

Of its points all are asked for, with angles of the file that is given; of two returns the first.
"""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

from hydra4.decoders import PandarOT128, PandarXT32

job = json.load(sys.stdin)
decoder = {"PandarXT-32": PandarXT32, "OT128": PandarOT128}[job["model"]](
    Path(job["angles"]), 0.0, 1e6
)
rows = []
for packet in job["packets"]:
    blocks = list(decoder(SimpleNamespace(data=bytes.fromhex(packet))))
    # Of the PandarXT-32 it leaves the second return out itself.
    for block in blocks[:: 2 if job["dual"] and job["model"] == "OT128" else 1]:
        rows += [[*map(float, point[:4]), int(point[4]), float(point[6])] for point in block.points]
print(json.dumps(rows))
