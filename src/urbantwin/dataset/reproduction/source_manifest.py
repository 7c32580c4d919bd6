"""``dataset.json`` as far as reproducing a dataset relies on it: read strictly.

A site or a rig in it names files by plain names only, and each in the list of its files: whatever
else it named would be opened wherever that is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from urbantwin.artefact import read_json
from urbantwin.artefact.manifest import Part, Sha256, validated
from urbantwin.errors import InputError

__all__ = ["NamedFile", "SourceManifest", "read_source_manifest", "value_at"]

_EXPECTED = "a dataset's manifest, as `urbantwin record` writes it"
_SENSOR_FILES = (".yaml", ".yml", ".json", ".csv", ".npz")
#: Where a site or a rig names files, as texts; ``*`` stands for the items of a list.
_NAMING = (
    *(
        f"{name}{field}"
        for name in ("osm", "sketch", "dem", "buildings", "roads", "corrections", "street_objects")
        for field in ("", ".file")
    ),
    "region.polygon",
    "rig",
    *(f"geometry.*{one}" for one in ("", ".file", ".url", ".footprints", ".control_points")),
    *(f"imagery.*{one}" for one in ("", ".file", ".xyz")),
    "traffic.assets.*.file",
    "sensors.*.model",
    "rig.sensors.*.model",
)

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


class _Background(Part):
    """A file of what a real sensor measured, and the sensor's name where that was given."""

    sensor: str | None
    name: Plain
    sha256: Sha256


class _Sources(Part):
    site: dict[str, Any]
    files: list[NamedFile]


class _Twin(Part):
    version: str
    made_from: _Sources


class _Made(Part):
    actors: Sha256
    meshes: Sha256


class _Motion(Part):
    urbantwin: str
    asked: dict[str, Any]
    made: _Made


_Share = Annotated[float, Field(ge=0, le=100)]
_Seconds = Annotated[float, Field(ge=0, le=1e6)]


class _Split(Part):
    shares: Annotated[list[_Share], Field(min_length=3, max_length=3)]
    gap_s: Annotated[float, Field(ge=0, le=86_400)] | None
    moved_m: Annotated[float, Field(ge=0, le=1000)] | None


class _Record(Part):
    rig: dict[str, Any]
    files: list[NamedFile]
    background: list[_Background]
    fuse: bool
    span_s: Annotated[list[_Seconds], Field(min_length=2, max_length=2)]
    every: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    split: _Split | None = None
    storage: Literal["npy", "zstd", "laz"] = "npy"


class _MadeFrom(Part):
    twin: _Twin | None
    motion: _Motion | None
    record: _Record | None


class _Input(Part):
    name: str
    licence: str = "not stated"
    attribution: str = "not stated"


class _Frame(Part):
    name: Plain
    sha256: Sha256


class _FirstSensor(Part):
    name: Plain


class _Rig(Part):
    fused: bool
    sensors: Annotated[list[_FirstSensor], Field(min_length=1)]


class _Dataset(Part):
    kind: Literal["dataset", "datasets"]
    urbantwin: str
    python: str
    platform: str
    dependencies: dict[str, str]
    backend: Annotated[str, Field(max_length=100)]
    seeds: dict[Literal["record", "traffic"], Annotated[int, Field(ge=0, lt=2**63)]]
    scene_sha256: Sha256
    motion_sha256: Sha256
    meshes_sha256: Sha256
    inputs: list[_Input]
    made_from: _MadeFrom
    rig: _Rig | None = None
    frames: list[_Frame] = Field(default_factory=list)
    tables_sha256: dict[Below, Sha256] = Field(default_factory=dict)
    datasets_sha256: dict[Plain, Sha256] = Field(default_factory=dict)


@dataclass(frozen=True)
class SourceManifest:
    """What ``dataset.json`` says of how the dataset was made.

    Attributes:
        file: where it was read.
        document: all of it.
        dataset: what of it is relied on.
        twin, motion, record: what these three were made from.
        part: of a dataset of one of several sensors, the sensor's name; else empty.
    """

    file: Path
    document: dict[str, Any]
    dataset: _Dataset
    twin: _Twin
    motion: _Motion
    record: _Record
    part: str


def read_source_manifest(file: Path) -> SourceManifest:
    """Read a dataset's manifest.

    Raises:
        InputError: it is missing or damaged, is of a version that did not say enough, or of a
            twin, a motion or a rig that `urbantwin` did not make from files.
    """
    document = read_json(file, kind="dataset")
    if document.get("kind") not in ("dataset", "datasets"):
        raise InputError("is not a dataset's", file=file, expected='"kind": "dataset"')
    if "made_from" not in document:
        raise InputError(
            "does not say what it was made from, as datasets of earlier versions do not",
            file=file,
            place="made_from",
            expected="a dataset of this version: record it again",
        )
    try:
        dataset = validated(document, _Dataset, file=file, expected=_EXPECTED)
    except RecursionError:
        raise InputError("is nested too deep", file=file, expected=_EXPECTED) from None
    came = dataset.made_from
    twin, motion, record = came.twin, came.motion, came.record
    if twin is None or motion is None or record is None:
        parts = {"twin": twin, "motion": motion, "recording": record}
        what = next(name for name, part in parts.items() if part is None)
        command = {"twin": "build", "motion": "drive", "recording": "record"}[what]
        raise InputError(
            f"does not say what its {what} was made from",
            file=file,
            place="made_from",
            expected=f"a {what} that `urbantwin {command}` made",
        )
    if (motion.made.actors, motion.made.meshes) != (dataset.motion_sha256, dataset.meshes_sha256):
        raise InputError(
            "its motion was changed after `urbantwin drive` made it: how is not recorded",
            file=file,
            place="motion_sha256",
            expected="a motion as it was made",
        )
    _check_files(twin.made_from.site, twin.made_from.files, file, "made_from.twin.made_from")
    _check_files(record.rig, record.files, file, "made_from.record")
    part = ""
    if dataset.kind == "dataset" and record.rig.get("fused") is False:
        if dataset.rig is None:
            raise InputError("is missing", file=file, place="rig", expected=_EXPECTED)
        part = dataset.rig.sensors[0].name
    return SourceManifest(file, document, dataset, twin, motion, record, part)


def value_at(document: Any, at: At) -> Any:  # noqa: ANN401
    """Return the value at the end of some steps, or ``None``."""
    for step in at:
        try:
            document = document[step]
        except (KeyError, IndexError, TypeError):
            return None
    return document


def _check_files(
    document: Mapping[str, Any], files: list[NamedFile], file: Path, place: str
) -> None:
    """Refuse a document that names a file otherwise than its list of files does.

    Raises:
        InputError: it does.
    """
    listed = {tuple(one.at): one for one in files}
    for at in _naming(document):
        one = listed.pop(at, None)
        named = value_at(document, at)
        if at[-1] == "model" and one is not None:
            named = str(named).rpartition(":")[2]
        if one is None or named != one.name or not (at[-1] in ("url", "xyz") or _is_plain(named)):
            raise InputError(
                f"names {str(named)!r:.60}, which its list of files does not",
                file=file,
                place=f"{place}: {'.'.join(map(str, at))}",
                expected="every file in the list, by its name without a folder",
            )
    if listed:
        first = ".".join(map(str, next(iter(listed))))
        raise InputError(
            f"lists a file for {first}, where none is named", file=file, place=f"{place}.files"
        )


def _is_plain(name: str) -> bool:
    try:
        return _plain(name) == name
    except ValueError:
        return False


def _naming(document: Mapping[str, Any]) -> Iterator[At]:
    """Yield where a site or a rig names a file."""
    for pattern in _NAMING:
        for at, value in _matches(document, pattern.split("."), ()):
            if at[-1] != "model" or value.lower().endswith(_SENSOR_FILES):
                yield at


def _matches(value: object, steps: list[str], at: At) -> Iterator[tuple[At, str]]:
    """Yield the texts at the end of some steps, and where they are."""
    if not steps:
        if isinstance(value, str):
            yield at, value
    elif steps[0] == "*" and isinstance(value, list):
        for number, one in enumerate(value):
            yield from _matches(one, steps[1:], (*at, number))
    elif isinstance(value, Mapping) and steps[0] in value:
        yield from _matches(value[steps[0]], steps[1:], (*at, steps[0]))
