"""Reproduction of a dataset from its manifest, with a comparison of bytes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge

from urbantwin.dataset.reproduction import Plan, make_again, plan_of
from urbantwin.errors import StageError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.summary import Result, Summary
from urbantwin.progress import Progress
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

__all__ = ["Reproduction", "reproduce"]


@dataclass(frozen=True, repr=False)
class Reproduction(Result):
    """Whether a dataset recorded again has the same bytes, and otherwise why not.

    Attributes:
        path: the dataset, or its manifest.
        plan: its inputs and versions.
        found: comparison of the files; ``None`` if inputs are missing.
        again: folder of the new results; ``None`` if they were not kept.
    """

    path: Path
    plan: Plan
    found: dict[str, Any] | None
    again: Path | None

    @property
    def same(self) -> bool:
        """Whether every file has the same bytes."""
        return self.found is not None and bool(self.found["same"])

    @property
    def reasons(self) -> list[str]:
        """Possible reasons of different bytes: versions, and changed inputs."""
        return self.plan.reasons()

    def __bool__(self) -> bool:
        """Return whether every file has the same bytes."""
        return self.same

    def __repr__(self) -> str:
        """Return the outcome in one line."""
        if self.found is None:
            return f"{self.path} lacks {len(self.plan.missing)} inputs to be made again"
        if self.same:
            return f"{self.path} made again: the same bytes in {self.found['files']} files"
        return f"{self.path} made again: {self._difference()}"

    def summary(self) -> Summary:
        """Return the outcome in brief."""
        before = {
            "path": str(self.path),
            "versions": self.plan.versions,
            "inputs": [one.told() for one in self.plan.inputs],
        }
        if self.found is None:
            return Summary({**before, "missing": [one.told() for one in self.plan.missing]})
        again = {} if self.again is None else {"again": str(self.again / "dataset")}
        same = f"{'yes' if self.same else 'no'}, {self.found['files']} files"
        return Summary({**before, "same_bytes": same, **self.found, **again})

    def check(self) -> None:
        """Raise an error if the dataset could not be reproduced or has other bytes.

        Raises:
            InputError: an input is missing; names the first.
            StageError: a file differs; names the first, with stage and reason.
        """
        self.plan.refuse_missing()
        if not self.same:
            raise StageError(f"{self.path}: {self._difference()}")

    def _difference(self) -> str:
        assert self.found is not None
        return (
            f"{self.found['differing']} of {self.found['files']} files differ, first "
            f"{self.found['first'][0]} (stage: {self.found['earliest']}): {self.found['why'][0]}"
        )


@command
def reproduce(
    path: AnyPath,
    *,
    inputs: Sequence[AnyPath] = (),
    out: AnyPath | None = None,
    twin: AnyPath | None = None,
    motion: AnyPath | None = None,
    workers: Annotated[int | None, Ge(1)] = None,
    progress: ShowProgress = True,
) -> Reproduction:
    """Record a dataset again, and compare the bytes.

    Uses the manifest; if the bytes differ, names the first stage that differs.

    Args:
        path: dataset's folder, or its ``dataset.json``.
        inputs: folder to search for inputs first, by name and SHA-256; then around the dataset and
            in the current folder.
        out: folder for twin, motion and dataset; nothing is kept if not given.
        twin: existing twin of the dataset, which is then not built again.
        motion: existing motion of the dataset, which is then not simulated again.
        workers: number of processes; every number gives the same bytes.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: not a dataset, or its manifest lacks its inputs.
        StageError: a stage failed.

    Example:
        >>> ut.dataset.reproduce("out/dataset").check()
        $ urbantwin dataset reproduce urbantwin-demo/dataset
    """
    given = Path(path)
    plan = plan_of(
        given,
        inputs=[Path(one) for one in inputs],
        twin=None if twin is None else Path(twin),
        motion=None if motion is None else Path(motion),
    )
    for reason in plan.reasons():
        tell_line(f"may change bytes: {reason}", progress)
    place = None if out is None else Path(out)
    if plan.missing:
        return Reproduction(given, plan, None, None)

    def draw(dataset: Path, twin: Twin, motion: Motion, tell: Progress) -> None:
        from urbantwin.drawing.pictures import pictures_of_dataset

        pictures_of_dataset(dataset, twin=twin, motion=motion, progress=tell)

    def stage(title: str) -> AbstractContextManager[Progress]:
        return shown_stage(title, progress)

    found = make_again(plan, stage=stage, out=place, workers=workers, draw=draw)
    return Reproduction(given, plan, found, place)
