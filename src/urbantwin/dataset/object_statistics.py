"""How dense a dataset is with objects, how much they hide each other, and how far they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    count = 0
    points: list[NDArray[Any]] = [np.zeros(0)]
    distances: list[NDArray[Any]] = [np.zeros(0)]
    occlusions: list[NDArray[Any]] = [np.zeros(0)]
    hidden: list[NDArray[Any]] = [np.zeros(0)]
    for entry in entries:
        frame = np.array(entry.get("dataset_SE3_site", dataset_SE3_site), np.float64)
        eyes = np.array(
            [[row[f"true_{axis}"] for axis in "xyz"] for row in entry["sweeps"]]
        ).reshape(-1, 3)
        places = (eyes @ frame[:3, :3].T + frame[:3, 3])[:, :2]
        meant = ~np.isin(entry["boxes"]["ignored"], BEYOND)
        boxes = {name: values[meant] for name, values in entry["boxes"].items()}
        count += int(meant.sum())
        telling, hit = boxes["num_points_alone"] >= _TELLING, boxes["num_points"] > 0
        occlusions.append(boxes["occlusion"][telling])
        hidden.append(~hit[telling])
        points.append(boxes["num_points"][hit])
        if len(places):
            away = [places[:, axis, None] - boxes[name][hit] for axis, name in enumerate("xy")]
            distances.append(np.hypot(*away).min(axis=0))
    every = [np.concatenate(one) for one in (points, distances, occlusions, hidden)]
    return _told(count / max(len(entries), 1), *every)


def _told(
    per_frame: float,
    points: NDArray[Any],
    distances: NDArray[Any],
    occlusions: NDArray[Any],
    hidden: NDArray[Any],
) -> dict[str, Any]:
    return {
        "per_frame": round(per_frame, 3),
        "occlusion": round(float(np.mean(occlusions)), 4) if len(occlusions) else None,
        "hidden": round(float(np.mean(hidden)), 4) if len(hidden) else None,
        "points": round(float(np.median(points)), 1) if len(points) else None,
        "distance_m": {
            "median": round(float(np.median(distances)), 2),
            "p90": round(float(np.percentile(distances, 90)), 2),
        }
        if len(distances)
        else None,
    }
