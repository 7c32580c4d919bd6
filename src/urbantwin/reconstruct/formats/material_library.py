"""Materials of an OBJ (``.mtl``): their names, colours and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.number_text import plain_number

__all__ = ["MtlMaterial", "read_materials"]

#: A library longer than this is none, bytes.
LONGEST = 50_000_000
#: Options of ``map_Kd`` and how many words follow each (MTL specification, "Options").
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-mm": 2, "-texres": 1, "-bm": 1}
_UP_TO_THREE = ("-o", "-s", "-t")


@dataclass
class MtlMaterial:
    """A material.

    Attributes:
        colour: diffuse colour (3,) as sRGB 0..255, or ``None``.
        picture: name of the picture laid over the faces, or empty.
    """

    colour: NDArray[np.uint8] | None = None
    picture: str = ""


def read_materials(path: Path) -> dict[str, MtlMaterial]:
    """Read a library; what is not understood in it is passed over.

    ``Kd`` is taken as sRGB, as the programs that show OBJ do.
    """
    if path.stat().st_size > LONGEST:
        return {}
    found: dict[str, MtlMaterial] = {}
    current = MtlMaterial()
    for line in path.read_bytes().decode("utf-8", "replace").splitlines():
        word, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        if word.lower() == "newmtl":
            current = found.setdefault(rest, MtlMaterial())
        elif word == "Kd":
            try:
                values = np.array([plain_number(text) for text in rest.split()[:3]])
            except ValueError:
                continue
            if values.shape == (3,) and np.isfinite(values).all():
                current.colour = np.round(np.clip(values, 0, 1) * 255).astype(np.uint8)
        elif word.lower() == "map_kd":
            current.picture = _without_options(rest)
    return found


def _without_options(rest: str) -> str:
    """Return the file's name, which may hold blanks, after the options before it."""
    words = rest.split(" ")
    while words and words[0] in (*_OPTIONS, *_UP_TO_THREE):
        option = words.pop(0)
        count = _OPTIONS.get(option, 3)
        while words and count:
            if option in _UP_TO_THREE and not _is_number(words[0]):
                break
            words.pop(0)
            count -= 1
    return " ".join(words).strip()


def _is_number(word: str) -> bool:
    try:
        plain_number(word)
    except ValueError:
        return False
    return True
