"""``blocks.parquet``: checksums of blocks of the frames' files, which tell where one is damaged.

The inventory's checksum says which file is not what was written. NumPy's format and SemanticKITTI's
labels have none of their own: without these, nothing would say which of a million numbers turned.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from isal import isal_zlib

from urbantwin.artefact.damaged_bytes import span
from urbantwin.artefact.tables import PARQUET, read_parquet
from urbantwin.dataset.reading.frame_files import FOLDERS
from urbantwin.errors import InputError

__all__ = ["BLOCKS", "damaged_block", "packed_sums", "write_block_sums"]

BLOCKS = "blocks.parquet"
#: Bytes of a block: a page of memory and of most disks, which is what is lost together.
_BYTES = 4096
_EXPECTED = "checksums of the blocks of frames"


def packed_sums(*parts: bytes | memoryview) -> dict[str, Any]:
    """Return the CRC-32 (RFC 1952) of each 4,096 bytes of a file, as JSON keeps it.

    Args:
        parts: of the file, in their order.

    Returns:
        ``bytes``, the file's size, and ``crc32``, the blocks' in their order: base64 of uint32.
    """
    sums: list[int] = []
    size, last = 0, 0
    for part in parts:
        # What the parts before left of a block, whole blocks, and what is left of them.
        begin = min(-size % _BYTES, len(part))
        last = isal_zlib.crc32(part[:begin], last)
        if begin and (size + begin) % _BYTES == 0:
            sums.append(last)
        end = begin + (len(part) - begin) // _BYTES * _BYTES
        sums += [isal_zlib.crc32(part[k : k + _BYTES]) for k in range(begin, end, _BYTES)]
        size += len(part)
        if begin < len(part):
            last = isal_zlib.crc32(part[end:])
    if size % _BYTES:
        sums.append(last)
    packed = base64.b64encode(np.array(sums, "<u4").tobytes()).decode()
    return {"bytes": size, "crc32": packed}


def write_block_sums(dataset: Path, entries: Iterable[Mapping[str, Any]]) -> None:
    """Write the checksums of the blocks of every file of a dataset's frames.

    ``file`` is the name in the dataset, ``bytes`` its size, ``crc32`` the blocks' in their order.

    Args:
        dataset: its folder.
        entries: what ``layout.write_frame`` returned for each frame.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    files = {name: one for entry in entries for name, one in entry["blocks"].items()}
    names = sorted(files, key=lambda name: (FOLDERS.index(name.partition("/")[0]), name))
    sums = [np.frombuffer(base64.b64decode(files[name]["crc32"]), "<u4") for name in names]
    # Put together by Arrow, a list at a time, they take a hundred times as long.
    starts = np.cumsum([0, *map(len, sums)], dtype=np.int32)
    every = np.concatenate([np.zeros(0, "<u4"), *sums])
    table = pa.table(
        {
            "file": pa.array(names, pa.string()),
            "bytes": pa.array([files[name]["bytes"] for name in names], pa.int64()),
            "crc32": pa.ListArray.from_arrays(pa.array(starts), pa.array(every)),
        }
    )
    pq.write_table(table, dataset / BLOCKS, **PARQUET)


def damaged_block(path: Path) -> str:
    """Return which bytes of a frame's file are not what was written; empty where nothing tells.

    Neighbouring blocks that are damaged are told together; of several places, the first.

    Raises:
        InputError: the table of checksums is damaged itself.
    """
    table = path.parent.parent / BLOCKS
    if not table.is_file():
        return ""
    name = f"{path.parent.name}/{path.name}"
    rows = read_parquet(table, _EXPECTED).to_pylist()
    try:
        told = {row["file"]: (int(row["bytes"]), list(row["crc32"])) for row in rows}
    except (KeyError, TypeError):
        raise InputError("has other columns", file=table, expected=_EXPECTED) from None
    if name not in told:
        return ""
    size, sums = told[name]
    found, have = _sums(path), path.stat().st_size
    wrong = [k for k, (one, other) in enumerate(zip(sums, found, strict=False)) if one != other]
    if not wrong:
        return f"byte {min(size, have)}: {have} bytes of {size}" if size != have else ""
    last = wrong[0]
    while last + 1 in wrong:
        last += 1
    more = sum(k > last for k in wrong)
    told_more = f", and {more} more block{'s' * (more != 1)}" if more else ""
    end = min((last + 1) * _BYTES, have)
    return f"{span(wrong[0] * _BYTES, end)}: not what was written{told_more}"


def _sums(path: Path) -> list[int]:
    data = memoryview(path.read_bytes())
    return [isal_zlib.crc32(data[k : k + _BYTES]) for k in range(0, len(data), _BYTES)]
