"""The files that a site or a rig in a manifest names: listed, and by plain names only."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from urbantwin.artefact.manifest import Part, Sha256
from urbantwin.errors import InputError

__all__ = [
    "At",
    "Below",
    "NamedFile",
    "Plain",
    "check_files",
    "set_at",
    "value_at",
]

_SENSOR_FILES = (".yaml", ".yml", ".json", ".csv", ".npz")
At = tuple[str | int, ...]


def _plain(name: str) -> str:
    if name in ("", ".", "..") or set(name) & set("/\\\0") or len(name) > 255:
        raise ValueError("the name of a file, without a folder")
    return name


def _below(name: str) -> str:
    parts = PurePosixPath(name).parts
    if not parts or ".." in parts or name.startswith("/") or "\0" in name or len(name) > 4096:
        raise ValueError("the name of a file beside another")
    return name


#: The name of a file without a folder, and one of a file below a folder.
Plain = Annotated[str, AfterValidator(_plain)]
Below = Annotated[str, AfterValidator(_below)]


class NamedFile(Part):
    """A file, a folder or an address that a document names.

    Attributes:
        at: where the document names it: the steps to the field.
        name: its own, without a folder; of an address or of tiles all of it.
        sha256: of the file; empty for a folder, an address and tiles.
        beside: name and SHA-256 of further files that belong to it.
        pixels_sha256: what tiles showed.
        shortened: of an address, whether a query or a user was left out.
        of: ``twin`` for a file that the twin holds.
    """

    at: Annotated[list[str | int], Field(min_length=2, max_length=6)]
    name: Annotated[str, Field(min_length=1, max_length=4096)]
    sha256: Sha256 | Literal[""]
    beside: dict[str, Sha256] = Field(default_factory=dict)
    pixels_sha256: str = ""
    shortened: bool = False
    of: Literal["twin"] | None = None

    @property
    def is_address(self) -> bool:
        """Whether it is fetched."""
        return self.at[-1] in ("url", "xyz") and re.match("https?://", self.name) is not None

    @property
    def are_tiles(self) -> bool:
        """Whether it is a pattern of local tiles."""
        return self.at[-1] == "xyz" and not self.is_address


def value_at(document: Any, at: At) -> Any:  # noqa: ANN401
    """Return the value at the end of some steps, or ``None``."""
    for step in at:
        try:
            document = document[step]
        except (KeyError, IndexError, TypeError):
            return None
    return document


def set_at(document: Any, at: At, value: str) -> None:  # noqa: ANN401
    """Put a value at the end of some steps that are there."""
    value_at(document, at[:-1])[at[-1]] = value


def check_files(
    document: Mapping[str, Any], files: list[NamedFile], file: Path, place: str
) -> None:
    """Refuse a document that names a file otherwise than its list of files does.

    What it names would be opened wherever that is.

    Raises:
        InputError: it does.
    """
    listed = {tuple(one.at): one for one in files}
    for at in _naming(document):
        one = listed.pop(at, None)
        named = value_at(document, at)
        if at[-1] == "model" and one is not None:
            named = str(named).rpartition(":")[2]
        if (
            one is None
            or named != one.name
            or (at[-1] not in ("url", "xyz") and not _is_plain(one))
        ):
            steps = ".".join(map(str, at))
            raise InputError(
                f"names {str(named)!r:.60}, which its list of files does not",
                file=file,
                place=f"{place}: {steps}",
                expected="every file in the list, by its name without a folder",
            )
    if listed:
        first = ".".join(map(str, next(iter(listed))))
        raise InputError(
            f"lists a file for {first}, where none is named", file=file, place=f"{place}.files"
        )


def _is_plain(one: NamedFile) -> bool:
    try:
        return _plain(one.name) == one.name
    except ValueError:
        return False


def _naming(document: Mapping[str, Any]) -> Iterator[At]:
    """Yield where a site or a rig names a file."""
    for name in ("osm", "sketch", "dem", "buildings", "roads", "corrections"):
        entry = document.get(name)
        if isinstance(entry, str):
            yield (name,)
        elif isinstance(entry, Mapping) and "file" in entry:
            yield (name, "file")
    region = document.get("region")
    if isinstance(region, Mapping) and isinstance(region.get("polygon"), str):
        yield ("region", "polygon")
    if isinstance(document.get("rig"), str):
        yield ("rig",)
    yield from _naming_sources(document)
    yield from _naming_actors(document)
    for before, rig in (((), document), (("rig",), document.get("rig"))):
        for number, one in enumerate(_list(rig, "sensors")):
            model = one.get("model") if isinstance(one, Mapping) else None
            if isinstance(model, str) and model.lower().endswith(_SENSOR_FILES):
                yield (*before, "sensors", number, "model")


def _naming_sources(document: Mapping[str, Any]) -> Iterator[At]:
    for name, fields in (
        ("geometry", ("file", "url", "footprints", "control_points")),
        ("imagery", ("file", "xyz")),
    ):
        for number, source in enumerate(_list(document, name)):
            if isinstance(source, str):
                yield (name, number)
            elif isinstance(source, Mapping):
                yield from (
                    (name, number, one) for one in fields if isinstance(source.get(one), str)
                )


def _naming_actors(document: Mapping[str, Any]) -> Iterator[At]:
    for number, one in enumerate(_list(document.get("traffic"), "assets")):
        if isinstance(one, Mapping) and isinstance(one.get("file"), str):
            yield ("traffic", "assets", number, "file")


def _list(document: object, name: str) -> list[Any]:
    found = document.get(name) if isinstance(document, Mapping) else None
    return found if isinstance(found, list) else []
