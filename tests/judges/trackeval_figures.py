"""What TrackEval says of tracks: its metrics alone, without what draws and reads files."""

import json
import sys
import types
from importlib.util import find_spec
from pathlib import Path

import numpy as np

found = find_spec("trackeval")
if found is None:
    sys.exit("trackeval is not installed")
package = types.ModuleType("trackeval")
package.__path__ = list(found.submodule_search_locations)
sys.modules["trackeval"] = package
metrics = types.ModuleType("trackeval.metrics")
metrics.__path__ = [str(Path(package.__path__[0]) / "metrics")]
sys.modules["trackeval.metrics"] = metrics

from trackeval.metrics.clear import CLEAR  # noqa: E402
from trackeval.metrics.hota import HOTA  # noqa: E402
from trackeval.metrics.identity import Identity  # noqa: E402

figures = []
for case in json.load(sys.stdin):
    labelled = [np.array(one, int) for one in case["labelled"]]
    followed = [np.array(one, int) for one in case["followed"]]
    data = {
        "num_timesteps": len(labelled),
        "gt_ids": labelled,
        "tracker_ids": followed,
        "similarity_scores": [
            np.array(one, float).reshape(len(a), len(b))
            for one, a, b in zip(case["similarity"], labelled, followed, strict=True)
        ],
        "num_gt_dets": sum(map(len, labelled)),
        "num_tracker_dets": sum(map(len, followed)),
        "num_gt_ids": len(set(np.concatenate(labelled))),
        "num_tracker_ids": len(set(np.concatenate(followed))),
    }
    quiet = {"PRINT_CONFIG": False, "THRESHOLD": 0.5}
    higher = HOTA().eval_sequence(data)
    clear = CLEAR(quiet).eval_sequence(data)
    whole = Identity(quiet).eval_sequence(data)
    figures.append(
        {
            "hota": float(np.mean(higher["HOTA"])),
            "deta": float(np.mean(higher["DetA"])),
            "assa": float(np.mean(higher["AssA"])),
            "mota": float(clear["MOTA"]),
            "motp": float(clear["MOTP"]),
            "swaps": int(clear["IDSW"]),
            "idf1": float(whole["IDF1"]),
        }
    )
print(json.dumps(figures))
