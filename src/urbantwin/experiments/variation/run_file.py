"""``run.yaml``: the twin, the motion and the recording settings of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from urbantwin.artefact import kind_of
from urbantwin.errors import InputError
from urbantwin.experiments.fields import (
    Duration,
    ExperimentFile,
    NamedFile,
    Seed,
    Time,
    document_of,
)
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import Document

__all__ = ["RunFile"]


class _Traffic(Strict):
    seconds: Duration | None = None
    seed: Seed | None = None
    demand: NamedFile | None = None
    scenario: NamedFile | None = None


class _Record(Strict):
    rig: NamedFile | None = None
    start: Time = 0.0
    stop: Time | None = None
    weather: Literal["clear", "rain", "fog", "snow"] | None = None
    visibility: Annotated[float, Field(gt=0.0)] | None = None
    effects: str | None = None
    seed: Seed | None = None


class RunFile(ExperimentFile):
    """A run.

    Attributes:
        twin: the twin's folder.
        motion: a motion's folder; ``None`` if traffic is simulated.
        traffic: settings of the simulated motion: ``seconds``, ``seed``, files of demand and
            scenario.
        record: the recording: file of the rig (``None`` for the twin's rig), time span, weather.
    """

    described_as: ClassVar[str] = "a run"

    twin: NamedFile = Field(description="a twin's folder")
    motion: NamedFile | None = None
    traffic: _Traffic = _Traffic()
    record: _Record = _Record()

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        if self.motion is not None and self.traffic != _Traffic():
            error = document_of(info).error
            raise error("is given beside traffic", ["motion"], "one of the two")
        return self

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a ``run.yaml``, or a folder written by ``urbantwin run``.

        Raises:
            InputError: it is neither, or a field is wrong; file and line are named.
        """
        if not path.is_dir():
            return super().read(path)
        if kind_of(path / "twin") != "twin":
            raise InputError("holds no twin", file=path, expected="a run.yaml, or a run's folder")
        names = [name for name in ("twin", "motion") if kind_of(path / name) == name]
        document = Document(path / "run.yaml", {name: name for name in names})
        return document.validated(cls, {"document": document})

    @property
    def inputs(self) -> list[Path | None]:
        """Input files and folders."""
        return [self.twin, self.motion, self.traffic.scenario, self.record.rig]
