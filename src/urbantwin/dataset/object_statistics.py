"""Statistics of a dataset's objects: density, occlusion, distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.result_warnings import BEYOND

__all__ = ["object_statistics"]

#: Occlusion is averaged over objects with at least this many points when unoccluded. With fewer,
#: the remaining ones are random, and high sensors see more of such: they would count as hidden more
#: often.
_TELLING = 10


def object_statistics(
    entries: Sequence[Mapping[str, Any]],
    dataset_SE3_site: Any,  # noqa: ANN401
) -> dict[str, Any]:
    """Return statistics of all objects in the region and in range, for ``dataset.json``.

    ``per_frame``: mean number; ``occlusion``: mean over those with ten or more points when
    unoccluded, and ``hidden``, the share of them without any point; ``points``, median over those
    with points; ``distance_m``: horizontal distance to the nearest sensor of those with points:
    ``median``, ``p90``. Null if there are none.

    Args:
        entries: return value of ``layout.write_frame`` for each frame.
        dataset_SE3_site: (4, 4) rows, for a fixed rig; for a rig on an actor each entry has its
            own.
    """
    count = 0
    points: list[NDArray[Any]] = [np.zeros(0)]
    distances: list[NDArray[Any]] = [np.zeros(0)]
    occlusions: list[NDArray[Any]] = [np.zeros(0)]
    hidden: list[NDArray[Any]] = [np.zeros(0)]
    for entry in entries:
        frame = np.array(entry.get("dataset_SE3_site", dataset_SE3_site), np.float64)
        sensors = np.array(
            [[row[f"true_{axis}"] for axis in "xyz"] for row in entry["sweeps"]]
        ).reshape(-1, 3)
        places = (sensors @ frame[:3, :3].T + frame[:3, 3])[:, :2]
        counts = ~np.isin(entry["boxes"]["ignored"], BEYOND)
        boxes = {name: values[counts] for name, values in entry["boxes"].items()}
        count += int(counts.sum())
        measurable, hit = boxes["num_points_alone"] >= _TELLING, boxes["num_points"] > 0
        occlusions.append(boxes["occlusion"][measurable])
        hidden.append(~hit[measurable])
        points.append(boxes["num_points"][hit])
        if len(places):
            away = [places[:, axis, None] - boxes[name][hit] for axis, name in enumerate("xy")]
            distances.append(np.hypot(*away).min(axis=0))
    values = [np.concatenate(part) for part in (points, distances, occlusions, hidden)]
    return _told(count / max(len(entries), 1), *values)


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
