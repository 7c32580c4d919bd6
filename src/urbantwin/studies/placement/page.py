"""The page of a placement: a front to click through, in one self-contained HTML file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from urbantwin.fidelity.report_html import html_table, write_html
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.studies.placement.pictures import MODEL_COLOURS
from urbantwin.studies.placement.place import Explained, Placed
from urbantwin.studies.placement.site_plan import Rings

__all__ = ["write_page"]

#: Of a layout, so many actors that it does not see are told on the page; the table has all.
_HIDDEN_TOLD = 40


def write_page(
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
    package = files(__package__)
    style, script = (
        package.joinpath(f"page.{kind}").read_text(encoding="utf-8") for kind in ("css", "js")
    )
    data = json.dumps(_data(placed, manifest, plan, reach_m), allow_nan=False)
    # Nothing in a text may end the script.
    data = data.replace("<", "\\u003c")
    name = str(placed.question.twin.manifest["name"])
    actors = ", ".join(f"{kind} {count}" for kind, count in manifest["actors"].items())
    doubts = [
        f'<p class="doubt">{escape(one["about"])}: {escape(one["problem"])}</p>'
        for one in manifest["warnings"]
    ]
    parts = [
        f"<style>{style}</style>",
        f"<h1>Placement: {escape(name)}</h1>",
        f'<p class="lead">{manifest["layouts"]} layouts of {manifest["candidates"]} places '
        f"judged by one motion; {len(placed.front)} that no other is as good as in all of "
        f"{escape(', '.join(manifest['objectives']))}.</p>",
        *doubts,
        f"<p>{manifest['moments']} moments, {manifest['step_s']:g} s apart; {escape(actors)}. "
        "Points are what a full recording gives on average; intervals are 95 %, over actors of "
        "this motion, and say nothing of other hours.</p>",
        _trained(manifest.get("trained")),
        '<div id="placement"></div>',
        "<details><summary>What the measures are</summary>",
        html_table(
            ("Measure", "Better", "Meaning", "Source"),
            [
                (key, "more" if one.more else "less", one.meaning, one.source or "ours")
                for key, one in MEASURES.items()
            ],
            text=True,
        ),
        "</details>",
        f"<script>const PLACEMENT = {data};\n{script}</script>",
    ]
    write_html(path, f"Placement: {name}", parts)


def _trained(rows: Sequence[Mapping[str, Any]] | None) -> str:
    if not rows:
        return ""
    head = ("Layout", "AP, %", "HOTA", "MOTA", "IDF1")
    cells = []
    for row in rows:
        between = ""
        if row["ap_low"] is not None and row["ap_high"] is not None:
            between = f" <small>{100 * row['ap_low']:.0f}–{100 * row['ap_high']:.0f}</small>"
        values = [_percent(row[name]) for name in ("ap", "hota", "mota", "idf1")]
        cells.append((str(row["layout"]), values[0] + between, *values[1:]))
    return "<h2>A detector for each</h2>" + html_table(head, cells)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f}"


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
