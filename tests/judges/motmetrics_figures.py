"""What py-motmetrics says of tracks that are as similar as a job tells, at a similarity of 0.5."""

import json
import sys

import motmetrics
import numpy as np

answers = []
metrics = motmetrics.metrics.create()
for scene in json.load(sys.stdin):
    told = motmetrics.MOTAccumulator(auto_id=True)
    for labelled, followed, similarity in zip(
        scene["labelled"], scene["followed"], scene["similarity"], strict=True
    ):
        near = np.array(similarity, float).reshape(len(labelled), len(followed))
        told.update(labelled, followed, np.where(near >= 0.5, 1 - near, np.nan))
    names = ["mota", "num_switches", "idf1"]
    row = metrics.compute(told, metrics=names, name="scene").iloc[0]
    answers.append({"mota": row["mota"], "swaps": row["num_switches"], "idf1": row["idf1"]})
print(json.dumps([{name: float(value) for name, value in one.items()} for one in answers]))
