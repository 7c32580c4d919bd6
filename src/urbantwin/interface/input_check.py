"""Check of a site's inputs for weaknesses, before anything is built."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.artefact import replaced_file
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Result, Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from urbantwin.weakness import Finding, InputCheck

__all__ = ["Findings", "check"]

#: Width of a page of text, characters, and most places listed per finding.
_WIDE, _PLACES = 100, 3


class Findings(Result):
    """Weaknesses of a site's inputs; printed as a list, in a notebook with a plan.

    Attributes:
        path: the ``site.yaml``.
        found: the findings, with the checked inputs.
    """

    def __init__(self, path: Path, found: InputCheck) -> None:
        self.path = path
        self.found = found

    def __len__(self) -> int:
        """Return the number of findings."""
        return len(self.found.findings)

    def __iter__(self) -> Iterator[Finding]:
        """Yield the findings, most important first."""
        return iter(self.found.findings)

    def plot(self) -> Figure:
        """Return the plan with the places of the findings, numbered as in the list."""
        from urbantwin.drawing.weakness_plan import weakness_figure

        return weakness_figure(self.found)

    def __repr__(self) -> str:
        """Return the list."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        much = sum(one.matters == "much" for one in self)
        yield f"{self.path}: {len(self)} findings, {much} of which matter{'s' * (much == 1)} much"
        for number, one in enumerate(self, 1):
            yield ""
            yield from _set_in(f"{number:>2}. {one.matters:<7}", f"{one.problem}.")
            yield from _set_in(" " * 11, f"Instead: {one.instead}.")
            where = f" ({one.where} in {self.path.name})" if one.where else ""
            yield from _set_in(" " * 11, f"To do: {one.remedy}{where}.")
            linked = [spot for spot in one.spots if not one.where]
            for spot in linked[:_PLACES]:
                yield f"{'':<11}{spot.name}: {spot.link}"
            if len(linked) > _PLACES:
                yield f"{'':<11}and {len(linked) - _PLACES} more (--json lists them)"

    def text(self) -> str:
        """Return the text that a command prints: the list."""
        return repr(self)

    def summary(self) -> Summary:
        """Return the findings in JSON-compatible form."""
        return Summary({"path": str(self.path), **self.found.as_json()})


@command
def check(
    site: AnyPath,
    *,
    picture: AnyPath | None = None,
    page: AnyPath | None = None,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> Findings:
    """List what a site's inputs lack, and where to add it.

    Args:
        site: ``site.yaml``, or its folder.
        picture: plan to write, PNG or SVG, with the numbered places of the findings.
        page: HTML page to write, with the list, its links and the plan.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the site or one of its inputs is missing or wrong.

    Example:
        >>> findings = ut.site.check("mysite", picture="weak.png")
        >>> findings.plot()
        $ urbantwin site check mysite/ -o weak.html
    """
    from urbantwin.site import load_site
    from urbantwin.weakness import check_inputs

    path = Path(site)
    path = path / "site.yaml" if path.is_dir() else path
    _check_ending(picture, ".png", ".svg")
    _check_ending(page, ".html", ".htm")
    with shown_stage("check", progress) as tell:
        checked = load_site(path)
        found = check_inputs(checked, progress=tell)
        if picture is not None:
            from urbantwin.drawing.weakness_plan import draw_weakness_plan

            with replaced_file(
                Path(picture), kind="check picture", inputs=checked.files()
            ) as scratch:
                draw_weakness_plan(found, scratch)
        if page is not None:
            from urbantwin.drawing.weakness_plan import write_weakness_page

            with replaced_file(Path(page), kind="check page", inputs=checked.files()) as scratch:
                write_weakness_page(found, scratch)
    return Findings(path, found)


def _check_ending(file: AnyPath | None, *endings: str) -> None:
    if file is not None and Path(file).suffix.lower() not in endings:
        expected = " or ".join(endings[:2])
        raise InputError("has another ending", file=Path(file), expected=f"a name with {expected}")


def _set_in(first: str, text: str) -> list[str]:
    return textwrap.wrap(
        text,
        _WIDE,
        initial_indent=first,
        subsequent_indent=" " * len(first),
        break_long_words=False,
        break_on_hyphens=False,
    )
