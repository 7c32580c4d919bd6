"""Options that several commands share, so that they read and behave alike."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "AllowKey",
    "AsJson",
    "KeyEnv",
    "Layout",
    "Out",
    "OutOrUrl",
    "Overwrite",
    "PartOfSplit",
    "Pictures",
    "Quiet",
    "Ray",
    "RigPicture",
    "RowWidth",
    "Seed",
    "SplitGap",
    "Thin",
    "Workers",
]

Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FOLDER",
        help="The folder to write.  [default: one beside what it is made from]",
    ),
]
OutOrUrl = Annotated[
    str | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FOLDER|URL",
        help="The folder to write, or storage: s3://bucket/name.  "
        "[default: a folder beside what it is made from]",
    ),
]
Ray = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="A Ray cluster to work on (an extra): HOST:PORT, auto, or local to start one.",
    ),
]
Layout = Annotated[
    str | None, typer.Option(help="Of the real frames.  [default: what their files tell]")
]
RowWidth = Annotated[
    int | None, typer.Option(min=3, help="Values per row of .bin files: 4 if not given.")
]
KeyEnv = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME", help="Let the site's file name this environment variable as a key."
    ),
]
AllowKey = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=ORIGIN",
        help="Let the key in this variable go to this server: TILES_KEY=https://tiles.example.org.",
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else there.")
]
Pictures = Annotated[
    bool, typer.Option("--pictures/--no-pictures", help="Draw pictures, which takes a while.")
]
RigPicture = Annotated[
    Path | None,
    typer.Option(metavar="PNG", help="The picture to write; beside the rig if not given."),
]
Seed = Annotated[
    int | None,
    typer.Option(min=0, help="The number that everything random follows from."),
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Processes to work with; every number gives the same bytes."),
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace a file that urbantwin did not write, or that was changed or made read-only.",
    ),
]
PartOfSplit = Annotated[
    str,
    typer.Option(metavar="NAME", help="Of datasets with a split: train, val, test or all frames."),
]
SplitGap = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        metavar="S",
        help="Seconds between the parts, in none of them.  [default: as long as the scene needs to "
        "change, a tenth of the recording at most]",
    ),
]
Thin = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        metavar="M",
        help="Leave frames in which nobody moved so many metres out of the parts.",
    ),
]
