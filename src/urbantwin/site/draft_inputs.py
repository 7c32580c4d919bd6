"""The lines of a first ``site.yaml`` that name inputs which were fetched, with where from."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from urbantwin.errors import readable
from urbantwin.site.fetched import FetchedInput

__all__ = ["fetched_lines", "fetched_of_kind", "map_lines", "quoted"]

#: What is said above an input, by its kind.
_HEADS = {
    "elevation": ("dem", "Elevation: a GeoTIFF that covers the region."),
    "buildings": (
        "buildings",
        "Footprints with heights: buildings that the map lacks are added, heights too.",
    ),
    "airborne": (
        "geometry",
        "A survey from the air: its ground, buildings and trees take the place of the map's.",
    ),
    "tiles": ("geometry", "3D Tiles; a build asks for them."),
    "imagery": ("imagery", "Pictures of the ground from above: paint, asphalt, grass and soil."),
}
#: Sections of ``site.yaml`` that hold lists.
_LISTS = ("geometry", "imagery")


def quoted(text: str) -> str:
    """Return a text as YAML has it: a JSON string is one, whatever is in it."""
    return json.dumps(text, ensure_ascii=not text.isprintable())


def fetched_of_kind(inputs: Sequence[FetchedInput], *kinds: str) -> list[FetchedInput]:
    """Return the inputs of some kinds."""
    return [one for one in inputs if one.kind in kinds]


def fetched_lines(inputs: Sequence[FetchedInput], named: Callable[[Path], str], *kinds: str) -> str:
    """Return the section of inputs of some kinds, empty where there are none.

    Args:
        inputs: all that were fetched.
        named: returns a file's name relative to the folder of ``site.yaml``.
        kinds: of one section.
    """
    text = ""
    for one in fetched_of_kind(inputs, *kinds):
        section, head = _HEADS[one.kind]
        is_list = section in _LISTS
        new = f"\n{section}:\n" not in f"\n{text}"
        mind = f"# Mind: {readable(one.caution)}.\n" if one.caution else ""
        text += f"# {head}\n{mind}" + (f"{section}:\n" if new else "")
        rows = _rows(one, named)
        first, *others = rows
        text += f"  - {first}\n" if is_list else f"  {first}\n"
        text += "".join(f"    {row}\n" if is_list else f"  {row}\n" for row in others)
    return f"{text}\n" if text else ""


def map_lines(one: FetchedInput) -> str:
    """Return what the map's entry says beside its file."""
    return "".join(f"  {row}\n" for row in _said(one))


def _rows(one: FetchedInput, named: Callable[[Path], str]) -> list[str]:
    rows = [] if one.path is None else [f"file: {quoted(named(one.path))}"]
    rows += [f"{name}: {quoted(value)}" for name, value in one.fields.items()]
    return rows + _said(one)


def _said(one: FetchedInput) -> list[str]:
    rows = [f"licence: {quoted(one.licence)}", f"attribution: {quoted(one.attribution)}"]
    if one.fetched is not None:
        rows += [
            "fetched:",
            f"  source: {one.fetched.source}",
            f"  url: {quoted(one.fetched.url)}",
            f'  at: "{one.fetched.at}"',
            f"  sha256: {one.fetched.sha256}",
        ]
    return rows
