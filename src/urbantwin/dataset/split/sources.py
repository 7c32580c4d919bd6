"""Datasets to be split together: search in folders, and the data that a split needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from urbantwin.dataset.description import parts_of
from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.dataset.split.actor_places import ActorPlaces, Recorded, places_of
from urbantwin.errors import InputError

__all__ = ["Source", "datasets_at"]

#: Depth of the search for datasets, in folders.
_DEEP = 6


@dataclass(frozen=True)
class Source:
    """A dataset, or a folder with one per sensor.

    Attributes:
        folder: its folder.
        manifest: its manifest.
    """

    folder: Path
    manifest: dict[str, Any]

    @cached_property
    def parts(self) -> tuple[tuple[Path, dict[str, Any]], ...]:
        """Folder and manifest of the dataset of each sensor, or of itself."""
        folders = parts_of(self.folder)
        return tuple((folder, read_manifest(folder)) for folder in folders)

    @cached_property
    def recorded(self) -> tuple[Recorded, ...]:
        """The part of each dataset that a split needs."""
        return tuple(
            Recorded(folder, manifest["frames"], manifest["dataset_SE3_site"])
            for folder, manifest in self.parts
        )

    @property
    def places(self) -> ActorPlaces:
        """Positions of its actors."""
        return places_of(self.recorded)

    @property
    def frames(self) -> int:
        """Number of frames, of all sensors together."""
        return max(len(manifest["frames"]) for _, manifest in self.parts)

    def frame_names(self) -> list[tuple[str, float]]:
        """Return name and time of each frame."""
        return [
            (str(frame["name"]), float(frame["time_s"])) for frame in self.parts[0][1]["frames"]
        ]


def datasets_at(paths: Sequence[Path]) -> list[Source]:
    """Return the datasets at some paths or in these folders, each once.

    Raises:
        InputError: none at a path, or one is damaged.
    """
    sources: dict[Path, Source] = {}
    for path in paths:
        if not path.exists():
            raise InputError("not found", file=path, expected="a dataset, or a folder of some")
        folders = list(_below(path, _DEEP)) if path.is_dir() else []
        if not folders:
            raise InputError(
                "holds no dataset", file=path, expected="what `urbantwin record` wrote"
            )
        for folder in folders:
            sources.setdefault(folder.resolve(), Source(folder, read_manifest(folder)))
    return list(sources.values())


def _below(folder: Path, deep: int) -> Iterator[Path]:
    if _is_dataset(folder):
        yield folder
        return
    if not deep:
        return
    try:
        inside = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=folder) from None
    for entry in inside:
        if entry.is_dir() and not entry.is_symlink() and not entry.name.startswith("."):
            yield from _below(entry, deep - 1)


def _is_dataset(folder: Path) -> bool:
    return (folder / "dataset.json").is_file()
