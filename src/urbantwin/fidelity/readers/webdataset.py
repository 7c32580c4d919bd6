"""WebDataset: shards of frames written by `urbantwin export --to webdataset`.

Shards are sequences of headers and arrays: files are located by their headers, and read on request.
"""

from __future__ import annotations

import tarfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import array_of_bytes, one_line
from urbantwin.artefact.document import json_value
from urbantwin.dataset.reading.columns import POINT
from urbantwin.errors import InputError
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.own import fields_of_rays
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.tables import boxes_of_rows, poses_of_frame
from urbantwin.io.trust import laid_out

__all__ = ["is_webdataset", "open_webdataset"]

_EXPECTED = "a shard of urbantwin export --to webdataset"
_POINTS = "points.npy"
_BLOCK = 512


def _shards(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix == ".tar" else []
    found = (
        file for file in path.glob("*.tar") if file.is_file() and not file.name.startswith(".")
    )
    return sorted(found, key=counting_order)


def is_webdataset(path: Path) -> bool:
    """Return whether a path is a shard or a folder of shards, whose first file holds points."""
    shards = _shards(path)
    if not shards:
        return False
    with shards[0].open("rb") as stream:
        name = stream.read(100).split(b"\0")[0]
    return name.endswith(f".{_POINTS}".encode())


@dataclass(frozen=True)
class _Member:
    shard: Path
    offset: int
    size: int


def open_webdataset(path: Path) -> Recording:
    """Open the frames of one shard or of all shards of a folder, in the order of their names.

    Raises:
        InputError: a shard is damaged; the error gives the position.
    """
    samples: dict[str, dict[str, _Member]] = {}
    for shard in _shards(path):
        for name, member in _members(shard):
            # With several datasets, the dataset's name precedes the frame's as a folder.
            dataset, slash, base = name.rpartition("/")
            stem, _, kind = base.partition(".")
            stem = f"{dataset}{slash}{stem}"
            if kind in samples.setdefault(stem, {}):
                raise InputError(f"holds {name} again", file=shard, expected=_EXPECTED)
            samples[stem][kind] = member
    names = sorted(samples, key=lambda name: counting_order(Path(name)))
    if not names:
        raise InputError("holds no samples", file=path, expected=_EXPECTED)

    def read(index: int) -> Frame:
        sample = samples[names[index]]
        if _POINTS not in sample:
            raise InputError(f"lacks {_POINTS}", file=path, place=names[index], expected=_EXPECTED)
        file = sample[_POINTS].shard
        points = _array(sample[_POINTS])
        with laid_out(file, _EXPECTED):
            if points.ndim != 2 or points.shape[1] != 4 or points.dtype != np.float32:
                raise ValueError(f"points of {points.dtype} of shape {points.shape}")
            fields: dict[str, NDArray[np.generic]] = dict(zip(POINT, points.T, strict=True))
            given: dict[str, NDArray[np.generic]] = {
                name: _array(sample[f"{name}.npy"])
                for name in ("semantic", "instance")
                if f"{name}.npy" in sample
            }
            if "rays.npy" in sample:
                given |= fields_of_rays(_array(sample["rays.npy"]))
            known: dict[str, Any] = {}
            if "boxes.json" in sample:
                known["boxes"] = boxes_of_rows(_json(sample["boxes.json"]))
            if "json" in sample:
                world, places = poses_of_frame(_json(sample["json"]))
                known |= {"world_SE3_frame": world, "sensor_places": places}
        return frame_of(file, fields, name=names[index], given=given, **known)

    return Recording(path, "webdataset", tuple(names), read)


def _members(shard: Path) -> list[tuple[str, _Member]]:
    """Return the files of a shard and their positions, from its headers."""
    size, found, at = shard.stat().st_size, [], 0
    with shard.open("rb") as stream:
        while True:
            stream.seek(at)
            header = stream.read(_BLOCK)
            if not header or not header.strip(b"\0"):
                break
            try:
                told = tarfile.TarInfo.frombuf(header, "utf-8", "strict")
            except (tarfile.HeaderError, UnicodeError) as error:
                raise InputError(
                    f"is damaged ({one_line(error)})",
                    file=shard,
                    place=f"byte {at}",
                    expected="the header of a file in a tar",
                ) from None
            if told.isreg():
                if told.size < 0 or at + _BLOCK + told.size > size:
                    raise InputError(
                        f"ends within {told.name[:60]}",
                        file=shard,
                        place=f"byte {size}",
                        expected=f"{told.size} bytes from byte {at + _BLOCK}",
                    )
                found.append((told.name, _Member(shard, at + _BLOCK, told.size)))
            at += _BLOCK + -(-max(told.size, 0) // _BLOCK) * _BLOCK
    return found


def _content(member: _Member) -> bytes:
    with member.shard.open("rb") as stream:
        stream.seek(member.offset)
        return stream.read(member.size)


def _array(member: _Member) -> NDArray[Any]:
    place = f"byte {member.offset}"
    return array_of_bytes(
        _content(member), file=member.shard, place=place, expected="an array of numpy"
    )


def _json(member: _Member) -> Any:  # noqa: ANN401
    return json_value(
        _content(member), file=f"{member.shard} (byte {member.offset})", expected=_EXPECTED
    )
