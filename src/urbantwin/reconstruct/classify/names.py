"""Classes and materials from the names of objects and materials (table: ``words.csv``)."""

from __future__ import annotations

import csv
import re
from functools import cache
from importlib.resources import files
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["labels_of_names", "table"]

#: Separators of words: symbols, digits, and changes from lower to upper case.
_APART = re.compile(r"[^A-Za-zÀ-ž]+|(?<=[a-zà-ž])(?=[A-ZÀ-Ž])")


def table(name: str) -> list[dict[str, str]]:
    """Return the rows of a table of this package, without comment lines."""
    lines = files(__package__).joinpath(name).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


@cache
def _rows() -> tuple[tuple[frozenset[str], int, int], ...]:
    """Return words, class and material (0: none) of each row."""
    return tuple(
        (
            frozenset(row["words"].split()),
            semantic_id(row["semantic"]) if row["semantic"] else 0,
            material_id(row["material"]) if row["material"] else 0,
        )
        for row in table("words.csv")
    )


def labels_of_names(names: tuple[str, ...]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Return the class and the material (N,) from names, 0 if unknown.

    ``"house 12 / Brick_Red"``: a building, of brick. The part after the last ``/`` is the
    material's name, as readers of models write it, which has priority for the material.
    """
    semantic = np.zeros(len(names), np.uint16)
    material = np.zeros(len(names), np.uint8)
    for number, name in enumerate(names):
        semantic[number], material[number] = _said(name)
    return semantic, material


@cache
def _said(name: str) -> tuple[int, int]:
    parts = [_words(part) for part in name.split("/")]
    every = frozenset().union(*parts)
    semantic = next((kind for words, kind, _ in _rows() if kind and words & every), 0)
    material = 0
    for part in reversed(parts):
        material = next((kind for words, _, kind in _rows() if kind and words & part), 0)
        if material:
            break
    return semantic, material


def _words(text: str) -> frozenset[str]:
    """Return the words of a name in lower case, joined neighbours, and singulars of plurals."""
    single = [word.lower() for word in _APART.split(text) if word]
    words = {*single, *(a + b for a, b in pairwise(single))}
    return frozenset(words | {word[:-1] for word in words if word.endswith("s")})
