"""Figures of objects in real boxes, by class and distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objects_in_boxes.measure import ObjectSeen

__all__ = ["EDGES_M", "FIGURES", "figures_of"]

#: Classes of distance, metres.
EDGES_M = (0.0, 10.0, 20.0, 40.0, 80.0)
#: Ratios of points count from so many real ones on, shares of rays from so many rays.
_POINTS, _RAYS = 20, 100

#: What each figure of a class at a distance is.
FIGURES = {
    "boxes": "labelled objects with 10 points or more",
    "points_ratio": "median over boxes of our points over real ones, in boxes mended to the points",
    "points_ratio_annotated": "the same in boxes as annotated",
    "chamfer_m": "median symmetric Chamfer distance along the same rays, boxes mended, metres",
    "chamfer_annotated_m": "the same in boxes as annotated",
    "chamfer_both_m": "the same in boxes mended, of rays that return from both: shape, not losses",
    "chamfer_opaque_m": "the same of those that meet no pane of our body first",
    "chamfer_again_m": "of all that return from both, our body to itself drawn again: the floor",
    "length_mended": "median of the mended over the annotated length",
    "width_mended": "the same of widths",
    "height_mended": "the same of heights",
    "code": "median intensity, percent of full scale",
    "code_p90": "the intensity that one point in ten exceeds, percent of full scale",
    "code_zero": "percent of points whose intensity is 0",
    "lost_opaque": "percent of rays at opaque parts that return nothing, between neighbours that "
    "return from the object",
    "lost_panes": "the same of rays at what is a pane of our body",
    "through_panes": "percent of points that were seen through a pane",
}


def figures_of(seen: Sequence[ObjectSeen]) -> list[dict[str, Any]]:
    """Return a row for each class at all distances, and for each of its distances.

    Figures that have a real and a simulated side are pairs ``{"real": .., "ours": ..}``; those
    with too few points or rays are ``None``.
    """
    rows = []
    for name in sorted({one.class_name for one in seen}):
        mine = [one for one in seen if one.class_name == name]
        spans = [(EDGES_M[0], EDGES_M[-1]), *pairwise(EDGES_M)]
        for low, high in spans:
            here = [one for one in mine if low <= one.distance_m < high]
            if here:
                rows.append({"class": name, "from_m": low, "to_m": high} | _figures(here))
    return rows


def _figures(seen: Sequence[ObjectSeen]) -> dict[str, Any]:
    judged = [one for one in seen if one.counts["real"] >= _POINTS]
    sizes = np.array([one.mended_box[3:6] / one.box[3:6] for one in seen])
    opaque, panes = _lost(seen, pane=False), _lost(seen, pane=True)
    return {
        "boxes": len(seen),
        "points_ratio": _ratio(judged, "mended"),
        "points_ratio_annotated": _ratio(judged, "annotated"),
        "chamfer_m": _chamfer(seen, "mended"),
        "chamfer_annotated_m": _chamfer(seen, "annotated"),
        "chamfer_both_m": _chamfer(seen, "both"),
        "chamfer_opaque_m": _chamfer(seen, "opaque"),
        "chamfer_again_m": _chamfer(seen, "again"),
        **{
            f"{side}_mended": round(float(np.median(sizes[:, axis])), 3)
            for axis, side in enumerate(("length", "width", "height"))
        },
        **_codes(seen),
        "lost_opaque": opaque,
        "lost_panes": panes,
        "through_panes": _through(seen),
    }


def _ratio(seen: Sequence[ObjectSeen], side: str) -> float | None:
    if not seen:
        return None
    return round(float(np.median([one.counts[side] / one.counts["real"] for one in seen])), 3)


def _chamfer(seen: Sequence[ObjectSeen], side: str) -> float | None:
    found = [one.chamfer_m[side] for one in seen]
    known = [one for one in found if one is not None]
    return round(float(np.median(known)), 4) if known else None


def _codes(seen: Sequence[ObjectSeen]) -> dict[str, Any]:
    real = np.concatenate([one.real_codes for one in seen])
    ours = np.concatenate([one.codes for one in seen])
    if min(len(real), len(ours)) < _RAYS:
        return dict.fromkeys(("code", "code_p90", "code_zero"))

    def pair(what: Mapping[str, float]) -> dict[str, float]:
        return {side: round(100 * value, 2) for side, value in what.items()}

    sides = {"real": real, "ours": ours}
    return {
        "code": pair({name: float(np.median(one)) for name, one in sides.items()}),
        "code_p90": pair({name: float(np.percentile(one, 90)) for name, one in sides.items()}),
        "code_zero": pair({name: float((one <= 1e-6).mean()) for name, one in sides.items()}),
    }


def _share(part: NDArray[np.bool_]) -> float:
    return round(100 * float(part.mean()), 2)


def _lost(seen: Sequence[ObjectSeen], *, pane: bool) -> dict[str, float] | None:
    rows = [one.rays for one in seen]
    chosen = [one.judged & (one.pane == pane) for one in rows]
    real = np.concatenate([one.real_lost[k] for one, k in zip(rows, chosen, strict=True)])
    ours = np.concatenate([one.lost[k] for one, k in zip(rows, chosen, strict=True)])
    if len(real) < _RAYS:
        return None
    return {"real": _share(real), "ours": _share(ours), "rays": len(real)}


def _through(seen: Sequence[ObjectSeen]) -> dict[str, float] | None:
    real, ours = (sum(one.counts[side] for one in seen) for side in ("real", "mended"))
    if min(real, ours) < _RAYS:
        return None
    return {
        "real": round(100 * sum(int(one.rays.real_far.sum()) for one in seen) / real, 2),
        "ours": round(100 * sum(int(one.rays.far.sum()) for one in seen) / ours, 2),
    }
