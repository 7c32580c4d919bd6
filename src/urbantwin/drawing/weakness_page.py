"""What is weak about a site's inputs as one HTML page: the list, its links, and the plan."""

from __future__ import annotations

from pathlib import Path

from urbantwin.drawing.weakness_plan import COLOURS, draw_weakness_plan
from urbantwin.pages import write_page
from urbantwin.weakness import InputCheck

__all__ = ["write_weakness_page"]

#: Places that are listed before the others are folded away.
_OPEN = 5


def write_weakness_page(found: InputCheck, path: Path) -> None:
    """Write the page; it needs no other file, and the same findings give the same bytes."""
    plan = draw_weakness_plan(found, path.with_name(f"{path.stem}.png"))
    template = "drawing/weakness_page.html.j2"
    write_page(path, template, found=found, site=found.site, plan=plan, colours=COLOURS, open=_OPEN)
    plan.unlink()
