"""Tuning: uncertain parameters of a rig and its actors, fitted to unlabelled real frames."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Ge

from urbantwin.artefact import check_folder, read_json
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from urbantwin.interface.motion import Motion
    from urbantwin.interface.twin import Twin

__all__ = ["Tuning", "tune"]


class Tuning(Artefact):
    """A fit, evaluated on held-out frames.

    ``ut.record(twin, motion, rig=tuning.rig)`` records with the tuned rig, and
    ``ut.drive(twin, demand=tuning.demand)`` simulates the tuned traffic.

    Attributes:
        folder: the tuning's folder; ``report.html`` in it is the report page.
        manifest: content of ``tuning.json``: parameters with initial values, fitted values and
            errors.
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_json(self.folder / "tuning.json", kind="tuning")

    @classmethod
    def open(cls, folder: AnyPath) -> Tuning:
        """Open a tuning's folder.

        Raises:
            InputError: the folder is not a tuning.
        """
        return cls(folder)

    @cached_property
    def held_out(self) -> dict[str, Any]:
        """Content of ``held_out.json``: evaluation on frames that were not used for the fit."""
        return read_json(self.folder / "held_out.json", kind="tuning")

    @property
    def rig(self) -> Path:
        """Path of the tuned ``rig.yaml``."""
        return self.folder / "rig.yaml"

    @property
    def demand(self) -> Path | None:
        """Path of the tuned ``traffic.yaml``, if actors were fitted."""
        path = self.folder / "traffic.yaml"
        return path if path.is_file() else None

    @property
    def values(self) -> dict[str, float]:
        """Value of each parameter."""
        return {name: float(one["value"]) for name, one in self.manifest["knobs"].items()}

    def __repr__(self) -> str:
        """Return the number of fitted parameters, and the folder."""
        states = [one["state"] for one in self.manifest["knobs"].values()]
        return f"Tuning: {states.count('fitted')} of {len(states)} knobs fitted ({self.folder})"

    def summary(self) -> Summary:
        """Return the fit in brief."""
        from urbantwin.fidelity.tuning.result import summary_of

        found = {**self.manifest, "held_out": self.held_out}
        return Summary(path=str(self.folder), **summary_of(found))

    def plot(self) -> Figure:
        """Draw the course of the fit, and distributions before and after."""
        from urbantwin.drawing.style import figure_of_picture

        return figure_of_picture(self.folder / "report.png")


@command
def tune(
    real: AnyPath,
    twin: Twin | AnyPath,
    motion: Motion | AnyPath | None = None,
    out: AnyPath | None = None,
    *,
    rig: AnyPath | None = None,
    fit: Annotated[str, "LIST"] = "pose,noise,dropout,reflectivity,actors",
    held_out: Annotated[float, "SHARE"] = 0.3,
    trials: Annotated[int, Ge(1)] = 300,
    seed: Annotated[int, Ge(0)] = 0,
    workers: Annotated[int | None, Ge(1)] = None,
    points_in: Literal["sensor", "level", "site"] | None = None,
    layout: str | None = None,
    columns: Annotated[int | None, Ge(3)] = None,
    report: bool = True,
    progress: ShowProgress = True,
) -> Tuning:
    """Fit a rig and its actors to unlabelled real frames.

    Args:
        real: real frames of the rig, in order of time.
        twin: twin, or its folder.
        motion: motion on the twin, to fit its actors.
        out: folder to write; ``tuned`` beside the twin if not given.
        rig: ``rig.yaml``; the twin's own rig if not given.
        fit: groups of parameters to fit, separated by commas.
        held_out: share of the frames, at the end, that is kept for evaluation.
        trials: number of trials per group.
        seed: random seed of the search.
        workers: number of threads; every number gives the same values.
        points_in: frame of the real points; the rig's if not given.
        layout: layout of the real frames; recognised from their files if not given.
        columns: values per row of ``.bin`` files; 4 if not given.
        report: measure and draw before and after.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: too few frames, a rig mounted on a vehicle, ``out`` holds other files, or the
            extra ``tune`` is not installed.

    Example:
        $ urbantwin rig tune real/ twin/ --rig rig.yaml -o tuned/
    """
    from urbantwin.extras import check_extra
    from urbantwin.fidelity.tuning import Tuning as Wish
    from urbantwin.fidelity.tuning import groups_of
    from urbantwin.fidelity.tuning import tune as tune_rig
    from urbantwin.interface.motion import Motion
    from urbantwin.interface.rig import rig_on
    from urbantwin.interface.twin import Twin
    from urbantwin.processes import usable_processors

    check_extra("tune", "fitting a rig")
    wish = Wish(
        fit=groups_of(fit),
        held_out=held_out,
        trials=trials,
        seed=seed,
        workers=workers or usable_processors(),
        points_in=points_in,
        layout=layout,
        columns=columns,
        report=report,
    )
    place = beside(twin, "tuned", out)
    given = [None if one is None else Path(one) for one in (real, twin, motion, rig)]
    frames, _, _, rig_file = given
    assert frames is not None
    check_folder(place, kind="tuning", inputs=given)
    on = Twin.open(twin)
    placed = rig_on(on, rig_file)
    moving = None if motion is None else Motion.open(motion)
    with shown_stage("tune", progress) as tell:
        tune_rig(
            frames,
            on,
            placed,
            on.rig_path if rig_file is None else rig_file,
            place,
            motion=moving,
            tuning=wish,
            progress=tell,
        )
    return Tuning(place)
