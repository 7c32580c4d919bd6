"""``urbantwin run``: a site's twin, motion and dataset, one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet, Workers

__all__ = ["EXAMPLES", "run"]

EXAMPLES = """
urbantwin run site.yaml -o out/
urbantwin run examples/two-avenues/site.yaml -o out/ --workers 2
"""


def run(
    site: Annotated[Path, typer.Argument(help="A site.yaml.")],
    out: Out,
    workers: Workers = None,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Go the whole way: twin, motion and dataset of a site."""
    from urbantwin.cli.stages import site_with_known_sensors, whole_line

    console = Console(quiet=quiet, as_json=as_json)
    checked = site_with_known_sensors(site)
    console.result(whole_line(checked, out, console, workers=workers, pictures=pictures))
