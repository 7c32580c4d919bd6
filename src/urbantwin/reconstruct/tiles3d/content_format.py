"""The format of a tile's content, by its first bytes; composites are split."""

from __future__ import annotations

import struct

import numpy as np

from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.tiles3d.b3dm import read_batched
from urbantwin.reconstruct.tiles3d.content import Content, Context, read_model
from urbantwin.reconstruct.tiles3d.i3dm import read_instanced
from urbantwin.reconstruct.tiles3d.pnts import read_points

__all__ = ["read_content"]

_DEEPEST = 8
_READERS = {b"b3dm": read_batched, b"i3dm": read_instanced, b"pnts": read_points}


@np.errstate(all="ignore")  # what is not a number is looked for, and told
def read_content(data: bytes, context: Context, depth: int = 0) -> Content:
    """Read a b3dm, i3dm, pnts, cmpt, glb or glTF.

    Args:
        data: its bytes, unpacked; more may follow within a composite.
        context: what it cannot know by itself.
        depth: how many composites are around it.

    Raises:
        MalformedError: nothing of it can be read.
    """
    magic = data[:4]
    if magic == b"glTF" or data[:64].lstrip()[:1] == b"{" or data[:3] == b"\xef\xbb\xbf":
        return read_model(data, context)
    if len(data) < 16:
        raise MalformedError("ends within its header" if data else "is empty")
    version, length = struct.unpack_from("<2I", data, 4)
    if magic not in (*_READERS, b"cmpt"):
        raise MalformedError(f"is of a format that is not known ({magic!r:.20})")
    if version != 1:
        raise MalformedError(f"is {magic.decode()} of version {version}, and not 1")
    if length > len(data):
        raise MalformedError(f"ends after {len(data)} of {length} bytes")
    if length < 16:
        raise MalformedError(f"says that it has {length} bytes, less than its header")
    if magic != b"cmpt":
        return _READERS[magic](data[:length], context)
    if depth >= _DEEPEST:
        raise MalformedError("is a composite in a composite beyond reason")
    return _read_composite(data[:length], context, depth)


def _read_composite(data: bytes, context: Context, depth: int) -> Content:
    """Read the tiles inside a cmpt; a bad one leaves the others.

    Source: 3D Tiles 1.0, section "Composite".
    """
    (count,) = struct.unpack_from("<I", data, 12)
    result, at, read = Content(), 16, 0
    for number in range(count):
        if at + 12 > len(data):
            result.problems.append(f"ends after {number} of {count} inner tiles")
            break
        (length,) = struct.unpack_from("<I", data, at + 8)
        if length < 12 or at + length > len(data):
            result.problems.append(f"inner tile {number} runs beyond the composite's end")
            break
        try:
            result.add(read_content(data[at : at + length], context, depth + 1))
            read += 1
        except MalformedError as error:
            result.problems.append(f"inner tile {number}: {error}")
        at += length
    if count and not read:
        raise MalformedError(result.problems[0])
    return result
