"""A plan for print: SVG and PNG, with cartographic symbols on white paper."""

from __future__ import annotations

from pathlib import Path

from urbantwin.artefact import replaced_file, replaced_folder, write_json
from urbantwin.drawing.pictures import attributions, title_of
from urbantwin.drawing.plan import plan_figure
from urbantwin.drawing.plan_style import PAPER
from urbantwin.drawing.style import save
from urbantwin.errors import InputError
from urbantwin.twin import Twin

__all__ = ["write_plan"]

ENDINGS = (".svg", ".png")


def write_plan(twin: Twin, path: Path) -> None:
    """Draw a twin's lanes, markings, signals and signs; see ``urbantwin.drawing.plan``.

    A ``path`` that ends in ``.svg`` or ``.png`` gives one file, otherwise a folder with both. The
    same twin gives the same bytes.

    Raises:
        InputError: the path is a file of another kind, or a folder with other files.
    """
    single = path.suffix.lower() in ENDINGS
    if single and path.is_dir():
        raise InputError("is a folder", file=path, expected="a file, such as plan.svg")
    if not single and path.is_file():
        raise InputError("is a file", file=path, expected="a folder, or a name that ends .svg")
    figure = plan_figure(
        twin.roads,
        twin.region,
        model=twin.lane_model,
        mesh=twin.mesh,
        sensors=twin.rig_spec().standing(),
        corrections=twin.corrections,
        title=title_of(twin),
        attribution=attributions(twin.manifest),
        look=PAPER,
    )
    if single:
        with replaced_file(path, kind="plan", inputs=[twin.folder]) as scratch:
            save(figure, scratch)
        return
    with replaced_folder(path, kind="plan", inputs=[twin.folder]) as folder:
        for ending in ENDINGS:
            save(figure, folder / f"plan{ending}")
        write_json(
            folder / "plan.json",
            {
                "kind": "plan",
                "twin": twin.manifest["name"],
                "twin_sha256": twin.sha256,
                "inputs": twin.manifest["inputs"],
            },
        )
