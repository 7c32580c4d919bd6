"""Splits of datasets into training, validation and test."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge

from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.result_warning import ResultWarning, warnings_of

__all__ = ["DatasetSplit", "split"]

_WAYS = ("time", "scenario")


@dataclass(frozen=True, eq=False, repr=False)
class DatasetSplit(Artefact):
    """Split of datasets; by scenario it can be passed as its document: ``ut.model.train(it)``.

    Attributes:
        path: the document; by time, the dataset, or the folder of the first one.
        by: ``time`` or ``scenario``.
        told: content of the document; by time, the split entry of each manifest, by folder.
    """

    path: Path
    by: str
    told: dict[str, Any]

    def __repr__(self) -> str:
        """Return the rule and the path."""
        return f"split by {self.by} ({self.path})"

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings."""
        if self.by == "scenario":
            return warnings_of(self.told)
        from urbantwin.dataset.split.time_split import warnings_of_split

        return tuple(
            dict.fromkeys(row for one in self.told.values() for row in warnings_of_split(one))
        )

    def summary(self) -> Summary:
        """Return the parts with their counts."""
        told = [str(one) for one in self.warnings]
        if self.by == "time":
            rows = {folder: _told(one) for folder, one in self.told.items()}
            own = next(iter(rows.values())) if len(rows) == 1 else {"datasets": rows}
            return Summary(path=str(self.path), by=self.by, **own, warnings=told)
        datasets = {
            part: [row["path"] for row in self.told["datasets"] if row["part"] == part]
            for part in self.told["parts"]
        }
        kept = {key: self.told[key] for key in ("parts", "parked", "thinned")}
        return Summary(path=str(self.path), by=self.by, **kept, datasets=datasets, warnings=told)


def _told(one: dict[str, Any]) -> dict[str, Any]:
    kept = ("gap_s", "scene_changes_in_s", "frames_in_gaps", "thinned", "actors", "parked")
    return {"frames": {k: v["frames"] for k, v in one["parts"].items()}} | {
        key: one[key] for key in kept if one[key] is not None
    }


@command
def split(
    datasets: Sequence[AnyPath] | AnyPath,
    out: AnyPath | None = None,
    *,
    by: Annotated[str | None, "time|scenario"] = None,
    shares: str | Sequence[float] = "70,15,15",
    gap: Annotated[float | None, Ge(0)] = None,
    thin: Annotated[float | None, Ge(0)] = None,
    seed: Annotated[int, Ge(0)] = 0,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> DatasetSplit:
    """Divide datasets into training, validation and test.

    By time, each dataset gets new lists (``ImageSets/``) and an updated card (unless edited by
    hand), and recordings of one motion are cut at the same times. By scenario, datasets are not
    changed, and a document assigns each to a part.

    Args:
        datasets: folders of datasets, or folders that hold several: seeds, a campaign, a
            curriculum, a variation or a suite.
        out: by scenario: document to write; ``split.json`` beside the first dataset if not given.
        by: way to divide: ``time`` or ``scenario``; by scenario where several are given.
        shares: shares of training, validation and test, percent.
        gap: by time: seconds between the parts, in none of them; as long as the scene needs to
            change, and no more than a tenth of the recording, if not given.
        thin: leave frames in which no actor moved this many metres out of the parts.
        seed: by scenario: random seed of the order of equally long scenarios.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: no dataset, a single scenario only, or an empty part.

    Example:
        >>> ut.model.train(ut.dataset.split(["seed1/dataset", "seed2/dataset", "seed3/dataset"]))
        $ urbantwin dataset split urbantwin-demo/dataset --shares 60,20,20
    """
    from urbantwin.artefact import check_file
    from urbantwin.dataset.split import (
        SplitAsked,
        datasets_at,
        split_by_scenario,
        split_datasets_in_time,
    )
    from urbantwin.dataset.split.document import write_split_document
    from urbantwin.dataset.split.scenarios import scenarios_of
    from urbantwin.experiments.campaign.index import datasets_of

    divided = _shares(shares)
    asked = SplitAsked(divided, gap, thin)
    given = [datasets] if isinstance(datasets, str | os.PathLike) else list(datasets)
    if not given:
        raise InputError("no dataset is given", expected="one or more")
    if by is not None and by not in _WAYS:
        raise InputError(f"unknown way {by!r:.40}", place="--by", expected=" or ".join(_WAYS))
    if seed < 0:
        raise InputError(f"is {seed}", place="--seed", expected="0 or more")
    # Use only datasets in a campaign's index: the folder may hold those of removed cells.
    inside = [of for one in given for of in datasets_of(Path(one)) or [Path(one)]]
    sources = datasets_at(inside)
    way = by or ("time" if len(sources) == 1 else "scenario")
    if way == "scenario" and gap is not None:
        raise InputError("is for parts of one recording", place="--gap", expected="--by time")
    if way == "time" and out is not None:
        raise InputError(
            "each dataset has its own lists", place="--out", expected="--by scenario, or no --out"
        )
    place = Path(out) if out is not None else _beside(Path(given[0]), sources[0].folder)
    if way == "scenario":
        check_file(place, kind="split")
    with shown_stage("split", progress, brief=True) as tell:
        tell(0.0, "which recordings show the same")
        scenarios = scenarios_of(sources)
        if way == "time":
            told: dict[str, Any] = {
                str(folder): one
                for folder, one in split_datasets_in_time(scenarios, asked, tell, _redraw).items()
            }
            made = DatasetSplit(Path(next(iter(told))), way, told)
        else:
            told = split_by_scenario(scenarios, divided, moved_m=thin, seed=seed)
            write_split_document(place, told)
            made = DatasetSplit(place, way, told)
    for one in made.warnings:
        tell_line(f"warning: {one}", progress)
    return made


def _redraw(dataset: Path) -> None:
    from urbantwin.drawing.pictures import redraw_split

    redraw_split(dataset)


def _shares(shares: str | Sequence[float]) -> tuple[float, float, float]:
    from urbantwin.dataset.split import shares_of

    return shares_of(shares, "--shares")


def _beside(given: Path, dataset: Path) -> Path:
    """Return the document's path: in the folder of several datasets, or beside the first."""
    if given.resolve() != dataset.resolve() and not any(given.glob("SHA256SUMS")):
        return given / "split.json"
    return beside(dataset, "split.json")
