"""What MMEngine makes of configs, and NumPy 1 of the pickles beside it."""

import json
import pickle
import sys
from pathlib import Path

import numpy as np
from mmengine.config import Config

folder = Path(sys.argv[1])
configs = {
    name: Config.fromfile(folder / f"{name}.py", import_custom_modules=False).to_dict()
    for name in ("pointpillars", "centerpoint")
}
answer = {"configs": configs, "numpy": np.__version__, "infos": {}}
for part in ("train", "val"):
    with (folder / f"custom_infos_{part}.pkl").open("rb") as stream:
        answer["infos"][part] = pickle.load(stream)
with (folder / "custom_dbinfos_train.pkl").open("rb") as stream:
    answer["objects"] = pickle.load(stream)
print(json.dumps(answer, default=lambda one: one.tolist()))
