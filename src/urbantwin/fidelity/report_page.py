"""The report as one self-contained HTML file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.report import Report
from urbantwin.pages import write_page

__all__ = ["Pictures", "write_report"]


@dataclass(frozen=True)
class Pictures:
    """The PNG files of the page.

    Attributes:
        measures: all measures.
        missing: the map of what the twin lacks; None if it lacks nothing.
        worst: the worst pairs, by their index in the report, worst first.
        objects: labelled objects; None without labels.
    """

    measures: Path
    missing: Path | None
    worst: Mapping[int, Path]
    objects: Path | None


def write_report(report: Report, pictures: Pictures, path: Path) -> None:
    """Write the page: the most important results first, all values at the end.

    Args:
        report: the report.
        pictures: its pictures.
        path: the HTML file; the same report gives the same bytes.
    """
    headline = report.headline()
    write_page(
        path,
        "fidelity/report.html.j2",
        report=report,
        headline=headline,
        measures=MEASURES,
        shown=[MEASURES[name] for name in headline["whole"]],
        worst=[report.frames[index] for index in report.worst()[:10]],
        objects=_objects(report),
        pictures=pictures,
    )


def _objects(report: Report) -> dict[str, dict[str, Any]]:
    """Return the rows of the table of labelled objects, by side."""
    rows = {}
    for side, name in (("synthetic", "Twin"), ("arbitrary", "Arbitrary site")):
        found = (report.objects or {}).get(f"{side}_against_real")
        if found is not None:
            classes = found["classes"].values()
            lengths = [one["dimensions"]["length_m"] for one in classes]
            ratios = [one["points_ratio"] for one in classes if one["points_ratio"] is not None]
            rows[name] = {
                **found,
                "longer_m": max(lengths, key=abs, default=None),
                "points_ratio": max(ratios, key=lambda one: abs(math.log(one)), default=None),
            }
    return rows
