"""``dataset.json`` as far as reproducing a dataset relies on it: read strictly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from urbantwin.artefact import read_json
from urbantwin.artefact.manifest import Part, Sha256
from urbantwin.dataset.reproduction.named_files import Below, NamedFile, Plain, check_files
from urbantwin.errors import InputError

__all__ = ["Background", "SourceManifest", "read_source_manifest"]

_EXPECTED = "a dataset's manifest, as `urbantwin record` writes it"


class Background(Part):
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


class _Split(Part):
    shares: Annotated[
        list[Annotated[float, Field(ge=0, le=100)]], Field(min_length=3, max_length=3)
    ]
    gap_s: Annotated[float, Field(ge=0, le=86_400)] | None
    moved_m: Annotated[float, Field(ge=0, le=1000)] | None


class _Record(Part):
    rig: dict[str, Any]
    files: list[NamedFile]
    background: list[Background]
    fuse: bool
    span_s: Annotated[
        list[Annotated[float, Field(ge=0, le=1e6)]], Field(min_length=2, max_length=2)
    ]
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
        InputError: it is missing or damaged, is of a version that did not tell enough, or of a
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
        dataset = _Dataset.model_validate(document)
    except (ValidationError, RecursionError) as error:
        raise _refused(error, file) from None
    came = dataset.made_from
    for what, known, command in (
        ("twin", came.twin, "build"),
        ("motion", came.motion, "traffic"),
        ("recording", came.record, "record"),
    ):
        if known is None:
            raise InputError(
                f"does not say what its {what} was made from",
                file=file,
                place="made_from",
                expected=f"a {what} that `urbantwin {command}` made",
            )
    twin, motion, record = came.twin, came.motion, came.record
    assert twin is not None
    assert motion is not None
    assert record is not None
    made = motion.made
    if (made.actors, made.meshes) != (dataset.motion_sha256, dataset.meshes_sha256):
        raise InputError(
            "its motion was changed after `urbantwin drive` made it: how is not recorded",
            file=file,
            place="motion_sha256",
            expected="a motion as it was made",
        )
    check_files(twin.made_from.site, twin.made_from.files, file, "made_from.twin.made_from")
    check_files(record.rig, record.files, file, "made_from.record")
    part = ""
    if dataset.kind == "dataset" and record.rig.get("fused") is False:
        if dataset.rig is None:
            raise InputError("is missing", file=file, place="rig", expected=_EXPECTED)
        part = dataset.rig.sensors[0].name
    return SourceManifest(file, document, dataset, twin, motion, record, part)


def _refused(error: ValidationError | RecursionError, file: Path) -> InputError:
    if isinstance(error, RecursionError):
        return InputError("is nested too deep", file=file, expected=_EXPECTED)
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(str(step)[:60] for step in first["loc"])
    if first["type"] == "missing":
        return InputError("is missing", file=file, place=place, expected=_EXPECTED)
    wanted = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return InputError("is wrong", file=file, place=place, expected=wanted)
