"""``urbantwin run``: a site's twin, motion and dataset, one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AllowKey, AsJson, KeyEnv, Out, Pictures, Quiet, Workers

__all__ = ["EXAMPLES", "run"]

EXAMPLES = """
urbantwin run site.yaml -o out/
urbantwin run examples/two-avenues/site.yaml -o out/ --workers 2
"""


def run(
    site: Annotated[Path, typer.Argument(help="A site.yaml.")],
    out: Out = None,
    workers: Workers = None,
    pictures: Pictures = True,
    key_env: KeyEnv = None,
    allow_key: AllowKey = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Go the whole way: twin, motion and dataset of a site."""
    made = ut.run(
        site,
        out,
        workers=workers,
        pictures=pictures,
        key_env=key_env,
        allow_key=allow_key,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
