"""Campaign folders: their datasets as one, by the levels at which they were recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import kind_of
from urbantwin.dataset.reading.selection import Selection
from urbantwin.errors import InputError, StageError
from urbantwin.interface.dataset import Datasets
from urbantwin.interface.place import AnyPath
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.dataset.reading import Dataset
    from urbantwin.exports.frames.shards import ShardSource

__all__ = ["INDEX", "KIND", "SHARDS", "SPLIT", "Campaign", "dataset_name", "shard_sources"]

KIND = "campaign"
#: Names in a campaign's folder: the index, the shards, and the split by scenario.
INDEX, SHARDS, SPLIT = "index", "shards", "split.json"
_AXES = ("site", "seed", "scenario", "rig", "weather", "sensor")
#: Largest number of failures listed in a summary.
_NAMED = 20


class Campaign(Datasets, Artefact):
    """All datasets of a campaign as one; for a plan, the remaining work.

    Attributes:
        folder: the campaign's folder; ``index/campaign.html`` in it is the overview page.
        manifest: content of ``index/campaign.json``; empty for a plan.
        plan: remaining work, for a plan.

    Example:
        >>> campaign = ut.open("campaign/")
        >>> campaign.where(weather="fog", classes=["car"], split="train")
    """

    def __init__(
        self,
        folder: AnyPath,
        manifest: dict[str, Any] | None = None,
        plan: Mapping[str, Any] | None = None,
        rows: Sequence[Mapping[str, Any]] | None = None,
    ) -> None:
        self.folder = Path(folder)
        self.manifest = manifest or {}
        self.plan = plan
        self._rows = tuple(self.manifest.get("datasets", []) if rows is None else rows)
        self._names = [dataset_name(row) for row in self._rows]
        self._divided = None

    @classmethod
    def open(cls, folder: AnyPath) -> Campaign:
        """Open a campaign's folder, or the index in it.

        Raises:
            InputError: the folder is not a campaign, or is damaged.
        """
        from urbantwin.experiments.campaign.index import read_index

        place = Path(folder)
        found = read_index(place)
        return cls(place.parent if kind_of(place) == KIND else place, found)

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """The datasets, in the order of the cells."""
        return self._opened

    @cached_property
    def _opened(self) -> tuple[Dataset, ...]:
        from urbantwin.interface.dataset import Dataset

        return tuple(Dataset(self.folder / row["path"]) for row in self._rows)

    @property
    def levels(self) -> tuple[dict[str, Any], ...]:
        """Levels of each dataset: ``site``, ``seed``, ``scenario``, ``rig`` and ``weather``.

        Also ``sensor`` if a rig has one dataset per sensor; other rigs then have ``fused``.
        """
        return tuple(dict(row["levels"]) for row in self._rows)

    def at(self, **levels: Any) -> Campaign:  # noqa: ANN401 - a level, or several
        """Return the datasets with given levels: ``at(weather="fog", seed=[1, 2])``.

        Raises:
            InputError: the axis or level does not exist.
        """
        axes: Mapping[str, list[Any]] = self.manifest.get("axes", {})
        wanted = {}
        for axis, given in levels.items():
            several = list(given) if isinstance(given, list | tuple | set) else [given]
            known = axes.get(axis)
            strange = [one for one in several if known is None or one not in known]
            if strange:
                raise InputError(
                    f"has no {axis} {strange[0]!r:.40}" if known else f"has no axis {axis!r:.40}",
                    file=self.folder,
                    expected=", ".join(map(str, known or axes)),
                )
            wanted[axis] = several
        rows = [
            row for row in self._rows
            if all(row["levels"][axis] in several for axis, several in wanted.items())
        ]  # fmt: skip
        return Campaign(self.folder, self.manifest, self.plan, rows)

    def where(self, **asked: Any) -> Selection:  # noqa: ANN401 - see `Frames.where`
        """Return frames of given levels, with selected boxes; see `Frames.where`.

        Args:
            asked: one or several levels of ``site``, ``seed``, ``scenario``, ``rig``, ``weather``,
                and of ``sensor`` if a rig has one dataset per sensor; and the arguments of
                `Frames.where`.

        Raises:
            InputError: a level, class, split, sequence or frame does not exist.
        """
        levels = {axis: asked.pop(axis, None) for axis in _AXES}
        levels = {axis: level for axis, level in levels.items() if level is not None}
        return self.at(**levels).where(**asked) if levels else super().where(**asked)

    def _part(self, dataset: Dataset, split: str) -> Any:  # noqa: ANN401
        if self._divided is None and (self.folder / SPLIT).is_file():
            from urbantwin.dataset.split import read_split_document

            self._divided = read_split_document(self.folder / SPLIT)
        return super()._part(dataset, split)

    def __repr__(self) -> str:
        """Return the numbers of datasets and frames, and the folder."""
        if not self.manifest:
            return f"a plan of a campaign ({self.folder})"
        frames = sum(row["frames"] for row in self._rows)
        return f"Campaign of {len(self._rows)} datasets of {frames} frames ({self.folder})"

    def summary(self) -> Summary:
        """Return counts and failures; for a plan, the estimated effort."""
        if not self.manifest:
            return Summary(path=str(self.folder), **dict(self.plan or {}))
        told = self.manifest
        failed = [f"{one['path']}: {one['why']}" for one in told["failed"]]
        more = [f"and {len(failed) - _NAMED} more"] if len(failed) > _NAMED else []
        shards = self.folder / SHARDS
        return Summary(
            path=str(self.folder),
            page=str(self.folder / INDEX / "campaign.html"),
            cells=told["cells"],
            datasets=len(told["datasets"]),
            **{name: told["counts"][name] for name in ("frames", "points", "boxes", "bytes")},
            axes={axis: len(levels) for axis, levels in told["axes"].items()},
            **({"shards": str(shards)} if kind_of(shards) else {}),
            failed=[*failed[:_NAMED], *more],
        )

    def check(self) -> None:
        """Raise an error if cells failed.

        Raises:
            StageError: a cell failed; names the first.
        """
        failed = self.manifest.get("failed", [])
        if failed:
            cells = self.manifest["cells"]
            raise StageError(
                f"{self.folder}: {len(failed)} of {cells} cells failed; the same command tries "
                f"them again; first {failed[0]['path']}: {failed[0]['why']}"
            )


def dataset_name(row: Mapping[str, Any]) -> str:
    """Return the name of a row's dataset within the campaign."""
    return "-".join(Path(row["path"]).parts[1:])


def shard_sources(made: Campaign) -> list[ShardSource]:
    """Return the datasets of a campaign as sources of shards."""
    from urbantwin.dataset.split import read_split_document
    from urbantwin.exports.frames.shards import ShardSource

    parts: dict[Path, str] = {}
    file = made.folder / SPLIT
    if file.is_file():
        parts = {path: part for path, part, _ in read_split_document(file).rows}
    return [
        ShardSource(folder := made.folder / row["path"], name, row["levels"], parts.get(folder))
        for name, row in zip(made._names, made._rows, strict=True)
    ]
