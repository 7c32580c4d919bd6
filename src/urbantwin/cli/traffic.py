"""``urbantwin traffic``: a twin's motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Seed

__all__ = ["EXAMPLES", "traffic"]

EXAMPLES = """
urbantwin traffic twin/ -o motion/
urbantwin traffic twin/ -o motion/ --seconds 300 --seed 7
urbantwin traffic twin/ -o motion/ --demand tuned/traffic.yaml
"""


def traffic(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Out,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, max=86400.0, help="Length of the motion; the site's if not given."),
    ] = None,
    seed: Seed = None,
    demand: Annotated[
        Path | None,
        typer.Option(help="Fields of `traffic:` that replace the site's: tuned/traffic.yaml."),
    ] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Drive a twin's traffic: every actor's pose at every step."""
    from urbantwin.artefact import check_folder
    from urbantwin.cli.summary import summary
    from urbantwin.site import load_traffic_changes
    from urbantwin.traffic import run_traffic
    from urbantwin.twin import load_twin

    console = Console(quiet=quiet, as_json=as_json)
    check_folder(out, kind="motion", inputs=[twin, demand])
    changes = None if demand is None else load_traffic_changes(demand)
    loaded = load_twin(twin)
    with console.stage("traffic") as progress:
        run_traffic(loaded, out, seconds=seconds, seed=seed, changes=changes, progress=progress)
    console.result(summary(out))
