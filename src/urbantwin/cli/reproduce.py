"""``urbantwin reproduce``: a dataset made again from its manifest, and compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet, Workers
from urbantwin.errors import StageError

if TYPE_CHECKING:
    from urbantwin.progress import Progress
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["EXAMPLES", "reproduce"]

EXAMPLES = """
urbantwin reproduce out/dataset/dataset.json
urbantwin reproduce dataset.json --inputs maps/ --inputs sensors/
urbantwin reproduce out/dataset -o again/ --workers 4
urbantwin reproduce out/dataset --twin out/twin --motion out/motion
urbantwin reproduce out/dataset --json | jq .why
"""


def reproduce(
    path: Annotated[Path, typer.Argument(help="A dataset's folder, or its dataset.json.")],
    inputs: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="Where inputs are looked for first, by name and SHA-256; then around the dataset "
            "and in the current folder.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Keep what is made: twin, motion and dataset. If not given, it goes again.",
        ),
    ] = None,
    twin: Annotated[
        Path | None, typer.Option(help="The dataset's twin, not to build it again.")
    ] = None,
    motion: Annotated[
        Path | None, typer.Option(help="The dataset's motion, not to simulate it again.")
    ] = None,
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Make a dataset again from its manifest, and say whether the bytes are the same or why not."""
    from urbantwin.dataset.reproduction import make_again, plan_of

    console = Console(quiet=quiet, as_json=as_json)
    plan = plan_of(path, inputs=inputs or (), twin=twin, motion=motion)
    before = {
        "path": str(path),
        "versions": plan.versions,
        "inputs": [one.told() for one in plan.inputs],
    }
    for reason in plan.reasons():
        console.note(f"may change bytes: {reason}")
    if plan.missing:
        console.result({**before, "missing": [one.told() for one in plan.missing]})
        plan.refuse_missing()

    def draw(dataset: Path, twin: Twin, motion: Motion, progress: Progress) -> None:
        from urbantwin.view.pictures import pictures_of_dataset

        pictures_of_dataset(dataset, twin=twin, motion=motion, progress=progress)

    report = make_again(plan, stage=console.stage, out=out, workers=workers, draw=draw)
    again = {} if out is None else {"again": str(out / "dataset")}
    same = f"{'yes' if report['same'] else 'no'}, {report['files']} files"
    console.result({**before, "same_bytes": same, **report, **again})
    if not report["same"]:
        raise StageError(
            f"{path}: {report['differing']} of {report['files']} files differ, first "
            f"{report['first'][0]} (stage: {report['earliest']}): {report['why'][0]}"
        )
