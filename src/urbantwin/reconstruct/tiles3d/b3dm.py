"""Batched 3D models (b3dm): a glTF with feature ids at its vertices."""

from __future__ import annotations

import struct

from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.tiles3d.content import Content, Context, read_model
from urbantwin.reconstruct.tiles3d.feature_table import FeatureTable, batch_names

__all__ = ["read_batched", "split_tables"]

#: No table is this long: the first bytes of '"' or 'glTF' stand where its length should.
_LEGACY = 0x22000000


def split_tables(
    data: bytes, start: int, lengths: tuple[int, int, int, int]
) -> tuple[list[bytes], bytes]:
    """Return the four parts of a tile's two tables, and what follows them.

    Raises:
        MalformedError: they run beyond the tile.
    """
    parts, at = [], start
    for length in lengths:
        if at + length > len(data):
            raise MalformedError("has tables that run beyond its end")
        parts.append(data[at : at + length])
        at += length
    return parts, data[at:]


def read_batched(data: bytes, context: Context) -> Content:
    """Read a b3dm, of which ``data`` is all of its bytes and no more.

    Source: 3D Tiles 1.0, section "Batched 3D Model"; the two shorter headers of before 2017 are
    distinguished as CesiumJS does it.

    Raises:
        MalformedError: nothing of it can be read.
    """
    if len(data) < 28:
        raise MalformedError("ends within its header")
    a, b, c, d = struct.unpack_from("<4I", data, 12)
    count = None
    if c >= _LEGACY:
        start, lengths, count = 20, (0, 0, b, 0), a
    elif d >= _LEGACY:
        start, lengths, count = 24, (0, 0, a, b), c
    else:
        start, lengths = 28, (a, b, c, d)
    parts, model = split_tables(data, start, lengths)
    table = FeatureTable(parts[0], parts[1])
    problems = []
    try:
        names = batch_names(
            parts[2], parts[3], table.count("BATCH_LENGTH") if count is None else count
        )
    except MalformedError as error:
        names, problems = [], [f"{error}; its features have no names"]
    content = read_model(model, context, feature_names=names, centre=table.vector("RTC_CENTER", 3))
    content.problems += problems
    return content
