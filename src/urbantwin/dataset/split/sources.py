"""Datasets that are split together: found in folders, and as far as a split needs them."""

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

#: So many folders deep is looked for datasets.
_DEEP = 6


@dataclass(frozen=True)
class Source:
    """A dataset, or a folder with one for each sensor.

    Attributes:
        folder: of it.
        manifest: of it.
    """

    folder: Path
    manifest: dict[str, Any]

    @cached_property
    def parts(self) -> tuple[tuple[Path, dict[str, Any]], ...]:
        """Folder and manifest of the dataset of each sensor, or of itself."""
        folders = parts_of(self.folder)
        return tuple((one, read_manifest(one)) for one in folders)

    @cached_property
    def recorded(self) -> tuple[Recorded, ...]:
        """What a split needs of each part."""
        return tuple(
            Recorded(one, manifest["frames"], manifest["dataset_SE3_site"])
            for one, manifest in self.parts
        )

    @property
    def places(self) -> ActorPlaces:
        """Where its actors are."""
        return places_of(self.recorded)

    @property
    def frames(self) -> int:
        """How many frames there are, of all sensors together."""
        return max(len(manifest["frames"]) for _, manifest in self.parts)

    def frame_names(self) -> list[tuple[str, float]]:
        """Return name and time of each frame."""
        return [(str(one["name"]), float(one["time_s"])) for one in self.parts[0][1]["frames"]]


def datasets_at(paths: Sequence[Path]) -> list[Source]:
    """Return the datasets at some paths: each one, and those in folders, each once.

    Raises:
        InputError: there is none at a path, or one is damaged.
    """
    found: dict[Path, Source] = {}
    for path in paths:
        if not path.exists():
            raise InputError("not found", file=path, expected="a dataset, or a folder of some")
        here = list(_below(path, _DEEP)) if path.is_dir() else []
        if not here:
            raise InputError(
                "holds no dataset", file=path, expected="what `urbantwin record` wrote"
            )
        for one in here:
            found.setdefault(one.resolve(), Source(one, read_manifest(one)))
    return list(found.values())


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
    for one in inside:
        if one.is_dir() and not one.is_symlink() and not one.name.startswith("."):
            yield from _below(one, deep - 1)


def _is_dataset(folder: Path) -> bool:
    return (folder / "dataset.json").is_file()
