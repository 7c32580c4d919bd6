"""How dense a dataset is with objects, how much they hide each other, and how far they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.dataset.result_warnings import BEYOND

__all__ = ["object_statistics"]

#: Occlusion is told of objects with so many points alone. Of one far away that might have three, it
#: is chance which it keeps, and higher sensors see more of such: they would count as hidden more.
_TELLING = 10


def object_statistics(
    entries: Sequence[Mapping[str, Any]],
    dataset_SE3_site: Any,  # noqa: ANN401
) -> dict[str, Any]:
    """Return what ``dataset.json`` says of all objects in the region and in reach.

    ``per_frame``: how many there are; ``occlusion``: its mean, of those that would have ten points
    alone, and ``hidden``, the share of them that has none; ``points``, the median of those that
    have any; ``distance_m``: in plan, from the nearest sensor, of those with points: ``median``,
    ``p90``. Null where there are none.

    Args:
        entries: what ``layout.write_frame`` returned for each frame.
        dataset_SE3_site: (4, 4) rows, of a rig that stands; entries of one that rides have theirs.
    """
    count, points, distances, occlusions, hidden = 0, [], [], [], []
    for entry in entries:
        frame = np.array(entry.get("dataset_SE3_site", dataset_SE3_site), np.float64)
        eyes = np.array(
            [[row[f"true_{axis}"] for axis in "xyz"] for row in entry["sweeps"]]
        ).reshape(-1, 3)
        places = (eyes @ frame[:3, :3].T + frame[:3, 3])[:, :2]
        for box in entry["boxes"]:
            if box["ignored"] in BEYOND:
                continue
            count += 1
            if box["num_points_alone"] >= _TELLING:
                occlusions.append(float(box["occlusion"]))
                hidden.append(not box["num_points"])
            if box["num_points"]:
                points.append(box["num_points"])
            if box["num_points"] and len(places):
                away = np.hypot(*(places - [box["x"], box["y"]]).T)
                distances.append(float(away.min()))
    return {
        "per_frame": round(count / max(len(entries), 1), 3),
        "occlusion": round(float(np.mean(occlusions)), 4) if occlusions else None,
        "hidden": round(float(np.mean(hidden)), 4) if hidden else None,
        "points": round(float(np.median(points)), 1) if points else None,
        "distance_m": {
            "median": round(float(np.median(distances)), 2),
            "p90": round(float(np.percentile(distances, 90)), 2),
        }
        if distances
        else None,
    }
