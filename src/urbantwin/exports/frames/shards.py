"""Many datasets as one stream of shards: frames of all of them, drawn among each other.

Who trains at scale reads shards one after the other, and shuffles no more than some hundred frames
in memory: frames of a shard must be of many recordings beforehand. Datasets are dealt out to groups
by the seed, and the frames of a group are shuffled; a shard holds frames of one group. With
`GROUP` datasets or fewer every frame can be in any shard.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np

from urbantwin import __version__
from urbantwin.artefact import kind_of, read_json, replaced_folder, sha256_of, write_json
from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress, untold

__all__ = [
    "FORMATS",
    "GROUP",
    "NO_PART",
    "ShardSource",
    "ShardWriter",
    "export_shards",
    "write_in_order",
]

#: Formats that datasets are written to as shards, and the module of the writer of each.
FORMATS = {"webdataset": "webdataset", "parquet": "parquet"}
#: So many datasets are open at once, whose frames are in the same shards.
GROUP = 64
#: Shards of frames that are in no part of the split.
NO_PART = "rest"
KIND = "exported"
#: A shard of a single dataset is closed when it has become so large: that streams well.
_ALONE_BYTES = 250_000_000


@dataclass(frozen=True)
class ShardSource:
    """A dataset that goes into shards.

    Attributes:
        folder: of the dataset.
        name: that tells its frames from those of others.
        levels: of the axes of a campaign, which each of its frames tells.
        part: of the split that all of it is in; ``None``: as its own lists say.
    """

    folder: Path
    name: str
    levels: Mapping[str, Any] = field(default_factory=dict)
    part: str | None = None


class ShardWriter(Protocol):
    """A shard that is being written."""

    @property
    def size(self) -> int:
        """Bytes so far, or near enough."""
        ...

    def add(self, frame: Frame, dataset: str, part: str | None, levels: Mapping[str, Any]) -> None:
        """Write a frame."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


def export_shards(
    sources: Sequence[ShardSource],
    to: str,
    out: Path,
    *,
    size: float = 500e6,
    seed: int = 0,
    inputs: Sequence[Path] = (),
    progress: Progress = untold,
) -> dict[str, Any]:
    """Write datasets as shards, ``PART-GGGG-NNNNN``; the same as there is stays.

    Args:
        sources: the datasets.
        to: one of `FORMATS`.
        out: the folder to write.
        size: of a shard, bytes; it ends with the frame that passes it.
        seed: of the order of the frames.
        inputs: what ``out`` must not touch.
        progress: told how far it is.

    Returns:
        What ``exported.json`` holds.

    Raises:
        InputError: a dataset is damaged, or ``out`` cannot be used.
        StageError: the disk is full.
    """
    digests = {one.name: sha256_of(one.folder / "dataset.json") for one in sources}
    told: dict[str, Any] = {
        "kind": KIND,
        "format": to,
        "urbantwin": __version__,
        "shards": {"bytes": int(size), "seed": seed, "datasets_shuffled_together": GROUP},
        "datasets": [
            {"name": one.name, "sha256": digests[one.name], "part": one.part} for one in sources
        ],
    }
    if kind_of(out) == KIND:
        there = read_json(out / f"{KIND}.json", kind=KIND)
        if all(there.get(key) == value for key, value in told.items()):
            return there
    with replaced_folder(out, kind=KIND, inputs=inputs) as folder:
        inputs_of: dict[str, Any] = {}
        frames = 0
        for count, share, known in _written(sources, to, folder, size, seed):
            frames += count
            inputs_of |= known
            progress(share, f"frame {frames}")
        shards = sorted(one.name for one in folder.iterdir())
        told = {**told, "frames": frames, "files": shards, "inputs": list(inputs_of.values())}
        write_json(folder / f"{KIND}.json", told)
    return told


def _written(
    sources: Sequence[ShardSource], to: str, folder: Path, size: float, seed: int
) -> Iterator[tuple[int, float, dict[str, Any]]]:
    """Write all shards; yield how many frames more there are, the share done, what they are of."""
    draw = np.random.default_rng(np.random.SeedSequence([seed, 0x5EED]))
    order = draw.permutation(len(sources)).tolist()
    groups = -(-len(sources) // GROUP)
    for group in range(groups):
        chosen = [sources[number] for number in order[group::groups]]
        opened = [FrameSource(one.folder) for one in chosen]
        known = {
            str(one.get("sha256") or one.get("name")): one
            for source in opened
            for one in source.manifest["inputs"]
        }
        parts: dict[str, list[tuple[int, int]]] = {}
        for which, (one, source) in enumerate(zip(chosen, opened, strict=True)):
            for number, name in enumerate(source.names):
                part = one.part or source.part_of(name) or NO_PART
                parts.setdefault(part, []).append((which, number))
        total = sum(map(len, parts.values()))
        done = 0
        for part, frames in sorted(parts.items()):
            drawn = [frames[number] for number in draw.permutation(len(frames)).tolist()]
            with _Shards(folder, f"{part}-{group:04d}", to, size) as shards:
                for which, number in drawn:
                    one = chosen[which]
                    told = None if part == NO_PART else part
                    shards.add(opened[which][number], one.name, told, one.levels)
                    done += 1
                    yield 1, (group + done / total) / groups, known


def write_in_order(
    source: FrameSource, folder: Path, to: str, tell: Progress, *, dataset: str = ""
) -> None:
    """Write a single dataset as shards ``PART-NNNNNN``, its frames in the order of time.

    Args:
        source: the dataset.
        folder: to write into.
        to: one of `FORMATS`.
        tell: told how far it is.
        dataset: what each frame calls it, if anything.
    """
    parts: dict[str, list[int]] = {}
    for number, name in enumerate(source.names):
        parts.setdefault(source.part_of(name) or NO_PART, []).append(number)
    done = 0
    for part, numbers in parts.items():
        with _Shards(folder, part, to, _ALONE_BYTES, digits=6) as shards:
            for number in numbers:
                tell(done / len(source), f"frame {source.names[number]}")
                shards.add(source[number], dataset, None if part == NO_PART else part, {})
                done += 1


class _Shards:
    """Shards of one name, each as large as it may be."""

    def __init__(self, folder: Path, stem: str, to: str, size: float, *, digits: int = 5) -> None:
        self._stem, self._size, self._digits = folder / stem, size, digits
        module = import_module(f"urbantwin.exports.frames.{FORMATS[to]}")
        self._new = module.new_shard
        self._number = 0
        self._open: ShardWriter | None = None
        self._stack = ExitStack()

    def add(self, frame: Frame, dataset: str, part: str | None, levels: Mapping[str, Any]) -> None:
        if self._open is None:
            stem = self._stem.with_name(f"{self._stem.name}-{self._number:0{self._digits}d}")
            self._open = self._stack.enter_context(self._new(stem))
        self._open.add(frame, dataset, part, levels)
        if self._open.size >= self._size:
            self._stack.close()
            self._open, self._number = None, self._number + 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
