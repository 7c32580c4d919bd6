"""``urbantwin check``: what is weak about a site's inputs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet

__all__ = ["EXAMPLES", "check"]

EXAMPLES = """
urbantwin check mysite/
urbantwin check mysite/ --picture weak.png --page weak.html
urbantwin check mysite/site.yaml --json | jq '.findings[].places[].link'
"""


def check(
    site: Annotated[Path, typer.Argument(help="A site.yaml, or the folder that it is in.")],
    picture: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Draw a plan with the places, numbered as in the list."),
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option(
            "--page",
            "-o",
            metavar="HTML",
            help="Write a page: the list with its links, and the plan.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """List what is weak about a site's inputs, and what to add where, before it is built."""
    found = ut.check(site, picture=picture, page=page, overwrite=overwrite, progress=not quiet)
    if as_json:
        Console(as_json=True).result(found.summary())
    elif not quiet:
        print(found)
