"""``urbantwin build``: a site's twin."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AllowKey, AsJson, KeyEnv, Out, Pictures, Quiet

__all__ = ["EXAMPLES", "build"]

EXAMPLES = """
urbantwin build site.yaml -o twin/
urbantwin build site.yaml -o twin/ --json | jq .counts
"""


def build(
    site: Annotated[Path, typer.Argument(help="A site.yaml.")],
    out: Out = None,
    pictures: Pictures = True,
    key_env: KeyEnv = None,
    allow_key: AllowKey = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Build a site's twin: ground, roads and labelled scene."""
    made = ut.build(
        site, out, pictures=pictures, key_env=key_env, allow_key=allow_key, progress=not quiet
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
