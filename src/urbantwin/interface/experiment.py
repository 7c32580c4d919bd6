"""Runs a grid of recordings: a campaign, a study or a curriculum, depending on its file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge

from urbantwin.errors import InputError
from urbantwin.interface.command import command, option_name
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress

if TYPE_CHECKING:
    from urbantwin.interface.campaign_folder import Campaign
    from urbantwin.interface.curriculum import Curriculum
    from urbantwin.interface.study import Study

__all__ = ["run"]


@command
def run(
    grid: AnyPath,
    out: AnyPath | None = None,
    *,
    plan: bool = False,
    most: Annotated[int | None, Ge(1)] = None,
    workers: Annotated[int | None, Ge(1)] = None,
    ray: Annotated[str | None, "ADDRESS"] = None,
    device: Annotated[str, "NAME"] = "cpu",
    progress: ShowProgress = True,
) -> Campaign | Study | Curriculum:
    """Run a grid: a campaign, a study or a curriculum.

    A file with ``sites`` is a campaign: every site is recorded with every seed, scenario, rig and
    weather (docs/howto/campaigns.md). A file with ``factors`` is a study: effects of faults,
    weather and traffic on detection. A file with ``ladder`` or ``grades`` is a curriculum: datasets
    of rising density, occlusion and range (both docs/howto/factors.md). Finished steps are kept,
    even if the grid changes; after an interruption, the same call continues.

    Args:
        grid: YAML file of the grid.
        out: folder to write; ``campaign``, ``study`` or ``graded`` beside the file if not given.
        plan: only print the remaining work, time and size; not for a curriculum.
        most: largest number of datasets of a campaign to record now.
        workers: number of processes; every number gives the same bytes.
        ray: Ray cluster for a campaign, with the files and ``out`` on all nodes: ``HOST:PORT`` of
            its head, ``auto`` for the one on this machine, ``local`` to start one.
        device: device of PyTorch for a study: ``cpu`` or ``cuda``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the file or a file that it names cannot be used, ``out`` holds another
            experiment, or an option does not apply to this kind of experiment.
        StageError: a stage failed, or the disk is full.

    Example:
        >>> ut.experiment.run("grid.yaml", plan=True).summary()
        >>> ut.experiment.run("grid.yaml").where(weather="fog", split="train")
        $ urbantwin experiment run grid.yaml --plan
    """
    file = Path(grid)
    kind = _kind(file)
    others = {
        "plan": plan and kind == "curriculum",
        "most": most is not None and kind != "campaign",
        "ray": ray is not None and kind != "campaign",
        "device": device != "cpu" and kind != "study",
    }
    for name, given in others.items():
        if given:
            raise InputError(f"a {kind} takes none", file=file, place=option_name(name))
    if kind == "campaign":
        from urbantwin.interface.campaign import campaign

        return campaign(
            file, out, plan=plan, most=most, workers=workers, ray=ray, progress=progress
        )
    if kind == "study":
        from urbantwin.interface.study import study

        return study(file, out, plan=plan, workers=workers, device=device, progress=progress)
    from urbantwin.interface.curriculum import curriculum

    return curriculum(file, out, workers=workers, progress=progress)


def _kind(file: Path) -> str:
    """Return the kind of experiment, by the fields of the grid."""
    from urbantwin.site.yaml_document import read_document

    fields = read_document(file, kind="a grid").value
    if "factors" in fields:
        return "study"
    return "curriculum" if {"ladder", "grades"} & set(fields) else "campaign"
