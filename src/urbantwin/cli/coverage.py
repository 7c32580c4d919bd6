"""``urbantwin coverage``: where a rig sees how much."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet

__all__ = ["EXAMPLES", "coverage"]

EXAMPLES = """
urbantwin coverage twin/ -o coverage/
urbantwin coverage twin/ --rig rig.yaml -o coverage/ --cell 1
"""


def coverage(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Out,
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml; the twin's own rig if not given.")
    ] = None,
    cell: Annotated[float, typer.Option(metavar="M", help="Side of a cell of the map.")] = 0.5,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Map the points per square metre that a rig gets from the ground and 1 m above it."""
    from urbantwin.artefact import check_folder, replaced_folder, write_json
    from urbantwin.cli.stages import rig_on
    from urbantwin.lidar.coverage import rig_coverage
    from urbantwin.twin import load_twin
    from urbantwin.view.pictures import picture_of_coverage

    console = Console(quiet=quiet, as_json=as_json)
    inputs = [twin, rig]
    check_folder(out, kind="coverage", inputs=inputs)
    loaded = load_twin(twin)
    placed = rig_on(loaded, rig)
    with replaced_folder(out, kind="coverage", inputs=inputs) as folder:
        with console.stage("coverage") as progress:
            found = rig_coverage(
                placed,
                loaded.mesh,
                loaded.region.bounds,
                cell_m=cell,
                surface=loaded.surface_materials,
                progress=progress,
            )
            found.save(folder / "coverage.npz")
        summary = {
            "kind": "coverage",
            "twin_sha256": loaded.sha256,
            "sensors": list(found.sensors),
            "rate_hz": found.rate_hz,
            "cell_m": cell,
            "unit": "points per square metre and frame",
            **found.summary(loaded.region),
        }
        write_json(folder / "coverage.json", summary)
        if pictures:
            picture_of_coverage(found, placed, loaded, folder / "coverage.png")
    console.result({"path": str(out), **summary})
