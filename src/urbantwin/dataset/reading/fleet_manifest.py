"""The schema of ``fleet.json`` that every reader of a fleet relies on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from urbantwin.artefact import read_json
from urbantwin.artefact.manifest import Part, PlainName, validated
from urbantwin.taxonomy import BoxKind

__all__ = ["KIND", "read_fleet_manifest"]

KIND = "fleet"

_Count = Annotated[int, Field(ge=0, lt=2**53)]
_Seconds = Annotated[float, Field(ge=-1e10, le=1e10)]


class _Sensor(Part):
    name: str
    model: str


class _Node(Part):
    name: PlainName
    rides: bool
    carrier: _Count | None = None
    seed: _Count
    frames: _Count
    frames_absent: _Count
    frames_lost: _Count
    points: _Count
    sensors: list[_Sensor]


class _Frame(Part):
    name: PlainName
    time_s: _Seconds


class _Fleet(Part):
    kind: Literal["fleet"]
    urbantwin: str
    rate_hz: Annotated[float, Field(gt=0, le=10_000)]
    boxes: BoxKind = "track"
    seeds: dict[str, _Count]
    inputs: list[dict[str, Any]]
    nodes: Annotated[list[_Node], Field(min_length=1)]
    frames: Annotated[list[_Frame], Field(min_length=1)]


def read_fleet_manifest(folder: Path) -> dict[str, Any]:
    """Read and check the manifest of a fleet.

    Raises:
        InputError: there is none, or a field is missing or wrong; it is named.
    """
    file = folder / f"{KIND}.json"
    manifest = read_json(file, kind=KIND)
    validated(manifest, _Fleet, file=file, expected="a fleet's manifest")
    return manifest
