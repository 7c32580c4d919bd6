"""``dataset.json`` as far as making a dataset again relies on it: read strictly."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from urbantwin.artefact import read_json
from urbantwin.errors import InputError

__all__ = ["At", "Background", "NamedFile", "Told", "read_told", "set_at", "value_at"]

_EXPECTED = "a dataset's manifest, as `urbantwin record` writes it"
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


Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Plain = Annotated[str, AfterValidator(_plain)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class NamedFile(_Part):
    """A file, a folder or an address that a document names.

    Attributes:
        at: where the document names it: the steps to the field.
        name: its own, without a folder; of an address or of tiles all of it.
        sha256: of the file; empty for a folder, an address and tiles.
        beside: name and SHA-256 of further files that belong to it.
        pixels_sha256: what tiles showed.
        of: ``twin`` for a file that the twin holds.
    """

    at: Annotated[list[str | int], Field(min_length=2, max_length=6)]
    name: Annotated[str, Field(min_length=1, max_length=4096)]
    sha256: Sha256 | Literal[""]
    beside: dict[Annotated[str, Field(max_length=4096)], Sha256] = Field(default_factory=dict)
    pixels_sha256: str = ""
    of: Literal["twin"] | None = None

    @property
    def is_address(self) -> bool:
        """Whether it is fetched."""
        return self.at[-1] in ("url", "xyz") and re.match("https?://", self.name) is not None

    @property
    def are_tiles(self) -> bool:
        """Whether it is a pattern of local tiles."""
        return self.at[-1] == "xyz" and not self.is_address


class Background(_Part):
    """A file of what a real sensor measured, and the sensor's name where that was given."""

    sensor: str | None
    name: Plain
    sha256: Sha256


class _Sources(_Part):
    site: dict[str, Any]
    files: list[NamedFile]


class _Twin(_Part):
    version: str
    made_from: _Sources


class _Made(_Part):
    actors: Sha256
    meshes: Sha256


class _Motion(_Part):
    urbantwin: str
    asked: dict[str, Any]
    made: _Made


class _Record(_Part):
    rig: dict[str, Any]
    files: list[NamedFile]
    background: list[Background]
    fuse: bool
    span_s: Annotated[list[Annotated[float, Field(ge=0, le=1e6)]], Field(min_length=2, max_length=2)]


class _MadeFrom(_Part):
    twin: _Twin | None
    motion: _Motion | None
    record: _Record | None


class _Input(_Part):
    name: str
    licence: str = "not stated"
    attribution: str = "not stated"


class _Frame(_Part):
    name: Plain
    sha256: Sha256


class _FirstSensor(_Part):
    name: Plain


class _Rig(_Part):
    fused: bool
    sensors: Annotated[list[_FirstSensor], Field(min_length=1)]


class _Dataset(_Part):
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
    tables_sha256: dict[Annotated[str, AfterValidator(_below)], Sha256] = Field(
        default_factory=dict
    )
    datasets_sha256: dict[Plain, Sha256] = Field(default_factory=dict)


@dataclass(frozen=True)
class Told:
    """What ``dataset.json`` tells.

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


def read_told(file: Path) -> Told:
    """Read a dataset's manifest.

    Raises:
        InputError: it is missing or damaged, is of a version that did not tell enough, or of a
            twin, a motion or a rig that `urbantwin` did not make from files.
    """
    document = read_json(file, kind="dataset")
    if document.get("kind") not in ("dataset", "datasets"):
        raise InputError("is not a dataset's", file=file, expected='"kind": "dataset"')
    if "made_from" not in document:
        raise InputError(
            f"was made by urbantwin {document.get('urbantwin', '?')!s:.20}, which did not tell what "
            "from",
            file=file,
            expected="a dataset of a later version: record it again",
        )
    try:
        dataset = _Dataset.model_validate(document)
    except (ValidationError, RecursionError) as error:
        raise _refused(error, file) from None
    twin, motion, record = (
        dataset.made_from.twin,
        dataset.made_from.motion,
        dataset.made_from.record,
    )
    for name, part, command in (
        ("twin", twin, "build"),
        ("motion", motion, "traffic"),
        ("record", record, "record"),
    ):
        if part is None:
            what = "recording" if name == "record" else name
            raise InputError(
                f"does not tell what its {what} was made from",
                file=file,
                place=f"made_from.{name}",
                expected=f"a {what} that `urbantwin {command}` made",
            )
    assert twin is not None
    assert motion is not None
    assert record is not None
    made = motion.made
    if (made.actors, made.meshes) != (dataset.motion_sha256, dataset.meshes_sha256):
        raise InputError(
            "its motion was changed after `urbantwin traffic` made it: nothing tells how",
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
    return Told(file, document, dataset, twin, motion, record, part)


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


def _check_files(
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
        if one is None or named != one.name or (at[-1] not in ("url", "xyz") and not _is_plain(one)):
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
    for name in ("osm", "dem", "roads"):
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
    for name, fields in (
        ("geometry", ("file", "url", "footprints", "control_points")),
        ("imagery", ("file", "xyz")),
    ):
        sources = document.get(name)
        for number, source in enumerate(sources if isinstance(sources, list) else []):
            if isinstance(source, str):
                yield (name, number)
            elif isinstance(source, Mapping):
                for field in fields:
                    if isinstance(source.get(field), str):
                        yield (name, number, field)
    for before, rig in (((), document), (("rig",), document.get("rig"))):
        sensors = rig.get("sensors") if isinstance(rig, Mapping) else None
        for number, one in enumerate(sensors if isinstance(sensors, list) else []):
            model = one.get("model") if isinstance(one, Mapping) else None
            if isinstance(model, str) and model.lower().endswith(_SENSOR_FILES):
                yield (*before, "sensors", number, "model")


def _refused(error: ValidationError | RecursionError, file: Path) -> InputError:
    if isinstance(error, RecursionError):
        return InputError("is nested too deep", file=file, expected=_EXPECTED)
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(str(step)[:60] for step in first["loc"])
    if first["type"] == "missing":
        return InputError("is missing", file=file, place=place, expected=_EXPECTED)
    wanted = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return InputError("is wrong", file=file, place=place, expected=wanted)
