"""The report of a fit as one self-contained HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from urbantwin.artefact import read_json
from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.tuning.figure import draw_fit
from urbantwin.fidelity.tuning.fit import RigFit
from urbantwin.fidelity.tuning.frames import Looks
from urbantwin.fidelity.tuning.simulated import SimulatedFrames
from urbantwin.pages import write_page

__all__ = ["write_report"]

#: Frames of each part that the distributions are of.
_DRAWN = 4


def write_report(
    out: Path,
    fit: RigFit,
    judged: dict[str, Any],
    training: Looks,
    held: Looks,
    sides: dict[str, SimulatedFrames],
    scale: float | None,
) -> None:
    """Write ``report.html`` and ``report.png`` beside ``tuning.json``.

    Args:
        out: the folder of the fit.
        fit: what was found.
        judged: what ``held_out.json`` holds.
        training: the frames that were fitted to.
        held: the frames held out.
        sides: of ``start`` and ``tuned``, the frames that the rig records.
        scale: full scale of real intensity.
    """
    few = range(_DRAWN)
    made = {name: [side.frame(k) for k in few] for name, side in sides.items()}
    parts = {
        part: {"real": looks.clouds[:: max(1, looks.frames // _DRAWN)][:_DRAWN], **made}
        for part, looks in (("training", training), ("held out", held))
    }
    draw_fit(fit, parts, None if training.intensity is None else scale, out / "report.png")
    write_page(
        out / "report.html",
        "fidelity/tuning/page.html.j2",
        fit=read_json(out / "tuning.json", kind="tuning"),
        judged=judged,
        measures=MEASURES,
        drawn=out / "report.png",
    )
