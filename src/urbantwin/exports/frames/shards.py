"""Many datasets as one stream of shards, with their frames shuffled together.

Training at scale reads shards sequentially and shuffles only some hundred frames in memory, so a
shard must already mix frames of many recordings. Datasets are randomly assigned to groups, and the
frames of a group are shuffled; a shard holds frames of one group. With `GROUP` datasets or fewer,
every frame can be in any shard.
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

#: Formats of shards, with the module of their writer.
FORMATS = {"webdataset": "webdataset", "parquet": "parquet"}
#: Number of datasets open at once, whose frames share shards.
GROUP = 64
#: Name of the shards of frames without a part of the split.
NO_PART = "rest"
KIND = "exported"
#: Size at which a shard of a single dataset is closed, bytes: suitable for streaming.
_ALONE_BYTES = 250_000_000


@dataclass(frozen=True)
class ShardSource:
    """A dataset written into shards.

    Attributes:
        folder: folder of the dataset.
        name: name that identifies its frames.
        levels: levels of the axes of a campaign, stored with each of its frames.
        part: part of the split of the whole dataset; ``None`` for its own lists.
    """

    folder: Path
    name: str
    levels: Mapping[str, Any] = field(default_factory=dict)
    part: str | None = None


class ShardWriter(Protocol):
    """A shard that is being written."""

    @property
    def size(self) -> int:
        """Approximate number of bytes so far."""
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
    """Write datasets as shards, ``PART-GGGG-NNNNN``; an equal existing export is kept.

    Args:
        sources: the datasets.
        to: one of `FORMATS`.
        out: the folder to write.
        size: size of a shard, bytes; it ends with the frame that exceeds it.
        seed: random seed of the order of frames.
        inputs: files and folders that ``out`` must not overlap.
        progress: called with the fraction done and a description.

    Returns:
        Content of ``exported.json``.

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
    """Write all shards; yield the number of new frames, the fraction done, and their inputs."""
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
    """Write a single dataset as shards ``PART-NNNNNN``, with frames in order of time.

    Args:
        source: the dataset.
        folder: folder to write into.
        to: one of `FORMATS`.
        tell: called with the fraction done and a description.
        dataset: name of the dataset stored with each frame, if any.
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
    """Shards with a common name, split by size."""

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
