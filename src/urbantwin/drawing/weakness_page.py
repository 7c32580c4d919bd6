"""What is weak about a site's inputs as one HTML page: the list, its links, and the plan."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path

from urbantwin.drawing.weakness_plan import COLOURS, draw_weakness_plan
from urbantwin.fidelity.report_html import html_picture, write_html
from urbantwin.weakness import Finding, InputCheck

__all__ = ["write_weakness_page"]

#: Places that are listed before the others are folded away.
_OPEN = 5


def write_weakness_page(found: InputCheck, path: Path) -> None:
    """Write the page; it needs no other file, and the same findings give the same bytes."""
    site = found.site
    date = "" if found.map_date is None else f", map of {found.map_date:%Y-%m-%d}"
    parts = [
        f"<h1>{escape(site.name)}: what is weak about its inputs</h1>",
        f'<p class="lead">{len(found.findings)} findings, what matters most first. Nothing was '
        f"built. {site.latitude:.5f}, {site.longitude:.5f}; {site.region.area:,.0f} m2"
        f"{date}.</p>",
    ]
    for number, one in enumerate(found.findings, 1):
        parts += _finding(number, one, site.file.name)
    plan = draw_weakness_plan(found, path.with_name(f"{path.stem}.png"))
    parts.append(html_picture("Where", plan))
    plan.unlink()
    if site.osm is not None:
        parts.append(f"<p><small>{escape(found.attribution)}</small></p>")
    write_html(path, f"{site.name}: inputs", parts)


def _finding(number: int, one: Finding, file: str) -> Iterator[str]:
    colour = COLOURS[one.matters]
    yield (
        f'<h2><span style="color:{colour}">&#9679;</span> {number}. {escape(one.problem)}</h2>'
        f"<p>It matters {one.matters}. Instead: {escape(one.instead)}. "
        f"<b>To do:</b> {escape(one.remedy)}"
        + (f" (<code>{escape(one.where)}</code> in {escape(file)})" if one.where else "")
        + ".</p>"
    )
    rows = [
        f'<li><a href="{escape(spot.link)}">{escape(spot.name)}</a> '
        f"<small>{escape(spot.element)} {spot.latitude:.5f}, {spot.longitude:.5f}</small></li>"
        for spot in one.spots
    ]
    if rows:
        yield "<ul>" + "".join(rows[:_OPEN]) + "</ul>"
    if len(rows) > _OPEN:
        yield (
            f"<details><summary>{len(rows) - _OPEN} more</summary><ul>"
            + "".join(rows[_OPEN:])
            + "</ul></details>"
        )
