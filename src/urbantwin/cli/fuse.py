"""``urbantwin fuse``: what nodes gain by telling each other what they see."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet

__all__ = ["EXAMPLES", "fuse"]

EXAMPLES = """
urbantwin fuse model/ fleet/ -o fusion/ --plan
urbantwin fuse model/ fleet/ -o fusion/ --workers 2
urbantwin fuse model/ fleet/ -o fusion/ --ego bus --node pole --node corner
urbantwin fuse model/ separate/ -o fusion/ --study bitrate --study loss --frames 100
urbantwin fuse model/ north/ south/ -o fusion/ --within 40 --mtu 9000
"""


def fuse(
    model: Annotated[Path, typer.Argument(help="A folder that `urbantwin train` wrote.")],
    data: Annotated[
        list[Path],
        typer.Argument(help="A fleet, datasets of `record --separate`, or a dataset per node."),
    ],
    out: Out = None,
    ego: Annotated[
        str | None, typer.Option(metavar="NAME", help="The node that receives.  [default: first]")
    ] = None,
    nodes: Annotated[
        list[str] | None,
        typer.Option("--node", metavar="NAME", help="This node takes part.  [default: all]"),
    ] = None,
    studies: Annotated[
        list[str] | None,
        typer.Option(
            "--study",
            metavar="NAME",
            help="bitrate, latency, clock, pose, loss, nodes, failure.  [default: all]",
        ),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=2, max=100_000, help="Judge by so many of the receiver's.")
    ] = 40,
    within: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=1.0,
            max=500.0,
            help="Nothing farther from it counts.  [default: the model's range]",
        ),
    ] = None,
    mtu: Annotated[
        int, typer.Option(metavar="BYTES", min=256, max=65_593, help="Of a packet.")
    ] = 1400,
    seed: Annotated[int, typer.Option(min=0, help="Of lost packets and errors of poses.")] = 0,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes; every number gives the same bytes.")
    ] = 1,
    plan: Annotated[bool, typer.Option("--plan", help="Only say how long it takes.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Compare clouds, features and boxes that nodes send each other: what they cost and gain.

    Run again after an interruption, it goes on from there.
    """
    made = ut.fuse(
        model,
        data,
        out,
        ego=ego,
        nodes=nodes,
        studies=studies,
        frames=frames,
        within=within,
        mtu=mtu,
        seed=seed,
        workers=workers,
        plan=plan,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
