"""``urbantwin verify``: whether artefacts are what was written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet
from urbantwin.errors import InputError

__all__ = ["EXAMPLES", "verify"]

EXAMPLES = """
urbantwin verify out/
urbantwin verify out/dataset
urbantwin verify twin/ --json | jq '.artefacts[].wrong'
"""

#: So many files are listed on a terminal; ``--json`` has all.
SHOWN = 20


def verify(
    path: Annotated[
        Path, typer.Argument(help="An artefact, or a folder of them: what `run` wrote.")
    ],
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Find files of artefacts that are damaged, missing or foreign, by their checksums."""
    from urbantwin.artefact import verify as verify_artefacts
    from urbantwin.processes import usable_processors

    console = Console(quiet=quiet, as_json=as_json)
    with console.stage("verify") as progress:
        found = verify_artefacts(path, workers=usable_processors(), progress=progress)
    most = None if as_json else SHOWN
    rows = [
        {
            "path": str(one.folder),
            "kind": one.kind,
            "files": one.files,
            "wrong": [{"file": bad.name, "is": bad.problem} for bad in one.damages[:most]],
        }
        for one in found
    ]
    console.result({"path": str(path), "artefacts": rows})
    wrong = [bad for one in found for bad in one.damages]
    if wrong:
        first = next(one for one in found if one.damages)
        raise InputError(
            f"{first.damages[0].name} is {first.damages[0].problem}"
            + (f", and {len(wrong) - 1} more are wrong" if len(wrong) > 1 else ""),
            file=first.folder,
            expected="the files as they were written; `urbantwin reproduce` makes a dataset again",
        )
