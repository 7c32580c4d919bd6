"""``run.yaml``: what is recorded, of which motion, on which twin."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from urbantwin.artefact import kind_of
from urbantwin.errors import InputError
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import must_exist, read_document

__all__ = ["RunFile", "load_run"]

Seconds = Annotated[float, Field(ge=0.0, le=86400.0, allow_inf_nan=False)]


class _Traffic(Strict):
    seconds: Annotated[float, Field(ge=0.1, le=86400.0)] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None
    demand: str | None = None
    scenario: str | None = None


class _Record(Strict):
    rig: str | None = None
    start: Seconds = 0.0
    stop: Seconds | None = None
    weather: Literal["clear", "rain", "fog", "snow"] | None = None
    visibility: Annotated[float, Field(gt=0.0)] | None = None
    effects: str | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None


class _Fields(Strict):
    twin: Annotated[str, Field(description="a twin's folder")]
    motion: str | None = None
    traffic: _Traffic = _Traffic()
    record: _Record = _Record()


@dataclass(frozen=True)
class RunFile:
    """A run, its files found.

    Attributes:
        file: where it was read, or the folder of a run.
        twin: the twin's folder.
        motion: a motion's folder; ``None`` where traffic is driven.
        seconds, traffic_seed, demand, scenario: of the traffic that is driven.
        rig: the rig's file; ``None`` for the twin's own.
        start, stop, weather, visibility, effects, seed: of the recording.
    """

    file: Path
    twin: Path
    motion: Path | None = None
    seconds: float | None = None
    traffic_seed: int | None = None
    demand: Path | None = None
    scenario: Path | None = None
    rig: Path | None = None
    start: float = 0.0
    stop: float | None = None
    weather: str | None = None
    visibility: float | None = None
    effects: str | None = None
    seed: int | None = None


def load_run(path: Path) -> RunFile:
    """Read a ``run.yaml``, or take the folder that ``urbantwin run`` wrote.

    Names of files are relative to the file.

    Raises:
        InputError: it is neither, or a field is wrong; file and line are named.
    """
    if path.is_dir():
        if kind_of(path / "twin") != "twin":
            raise InputError("holds no twin", file=path, expected="a run.yaml, or a run's folder")
        has_motion = kind_of(path / "motion") == "motion"
        return RunFile(path, path / "twin", path / "motion" if has_motion else None)
    document = read_document(path, kind="a run")
    fields = document.validated(_Fields)
    if fields.motion is not None and fields.traffic != _Traffic():
        raise document.error("is given beside traffic", ["motion"], "one of the two")

    def beside(name: str | None, *place: str) -> Path | None:
        if name is None:
            return None
        found = path.parent / name
        must_exist(document, place, found, "a file beside the run's", folders=True)
        return found

    twin = beside(fields.twin, "twin")
    assert twin is not None
    return RunFile(
        path,
        twin,
        beside(fields.motion, "motion"),
        fields.traffic.seconds,
        fields.traffic.seed,
        beside(fields.traffic.demand, "traffic", "demand"),
        beside(fields.traffic.scenario, "traffic", "scenario"),
        beside(fields.record.rig, "record", "rig"),
        fields.record.start,
        fields.record.stop,
        fields.record.weather,
        fields.record.visibility,
        fields.record.effects,
        fields.record.seed,
    )
