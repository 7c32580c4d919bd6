"""The page of a placement: a front to click through, in one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from urbantwin.pages import write_page
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.studies.placement.pictures import MODEL_COLOURS
from urbantwin.studies.placement.place import Explained, Placed
from urbantwin.studies.placement.site_plan import Rings

__all__ = ["write_placement_page"]

#: Of a layout, so many actors that it does not see are told on the page; the table has all.
_HIDDEN_TOLD = 40


def write_placement_page(
    path: Path,
    placed: Placed,
    manifest: Mapping[str, Any],
    plan: Mapping[str, Rings],
    reach_m: float,
) -> None:
    """Write the page; the same placement gives the same bytes.

    Args:
        path: the HTML file.
        placed: what was found.
        manifest: ``placement.json``.
        plan: of the site.
        reach_m: half the edge of the plan.
    """
    write_page(
        path,
        "studies/placement/page.html.j2",
        name=placed.question.twin.manifest["name"],
        manifest=manifest,
        doubts=[f"{one['about']}: {one['problem']}" for one in manifest["warnings"]],
        measures=MEASURES,
        data=_data(placed, manifest, plan, reach_m),
    )


def _data(
    placed: Placed, manifest: Mapping[str, Any], plan: Mapping[str, Rings], reach_m: float
) -> dict[str, Any]:
    question = placed.question
    views = question.views
    models = [Path(one.model).name for one in question.spec.models]
    return {
        "objectives": manifest["objectives"],
        "measures": {
            name: {"more": one.more, "unit": one.unit, "meaning": one.meaning}
            for name, one in MEASURES.items()
        },
        "models": [
            {"name": name, "colour": MODEL_COLOURS[k % len(MODEL_COLOURS)]}
            for k, name in enumerate(models)
        ],
        "places": [
            {"name": one.name, "kind": one.kind, "x": one.east_m, "y": one.north_m}
            for one in views.mounts
        ],
        "middle": list(question.spec.middle_m),
        "reach": reach_m,
        "plan": dict(plan),
        "layouts": [
            {
                "values": one.verdict.values,
                "intervals": one.verdict.intervals,
                "sensors": [
                    {
                        "place": views.every[number].mount,
                        "model": views.every[number].model,
                        "height": views.every[number].height_m,
                        "tilt": views.every[number].tilt_deg,
                        "yaw": views.every[number].yaw_deg,
                    }
                    for number in one.layout
                ],
            }
            for one in placed.found
        ],
        "front": [_explained(one) for one in placed.explained],
    }


def _explained(one: Explained) -> dict[str, Any]:
    return {
        "layout": one.number,
        "classes": [
            [row.kind, row.from_m, None if row.to_m == float("inf") else row.to_m]
            + [row.seconds, row.points, *row.seen]
            for row in one.by_class
        ],
        "hidden": [
            [row.track, row.kind, row.from_s, row.seconds, *row.middle, list(row.behind)]
            for row in one.hidden[:_HIDDEN_TOLD]
        ],
        "unseen": len(one.hidden),
    }
