"""Fields that files of experiments share: seeds, spans of time, and files that they name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, model_validator

from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import Document, not_there, read_document, wrong

__all__ = ["Duration", "ExperimentFile", "NamedFile", "Seed", "Seeds", "Time", "document_of"]

#: Random seed.
Seed = Annotated[int, Field(ge=0, lt=2**31)]
#: Length of a motion, and a time in it, seconds.
Duration = Annotated[float, Field(ge=0.1, le=86400.0)]
Time = Annotated[float, Field(ge=0.0, le=86400.0)]


def _each_once(seeds: list[int]) -> list[int]:
    if len(set(seeds)) < len(seeds):
        raise wrong("names a seed twice", "each seed once")
    return seeds


Seeds = Annotated[list[Seed], Field(min_length=1), AfterValidator(_each_once)]


def _beside(name: str, info: ValidationInfo) -> Path:
    path = document_of(info).file.parent / name
    problem = not_there(path, folders=True)
    if problem is not None:
        raise wrong(problem, "a name beside this file")
    return path


if TYPE_CHECKING:
    NamedFile = Path
else:  # text in the file: a name relative to it
    NamedFile = Annotated[str, AfterValidator(_beside)]


def document_of(info: ValidationInfo) -> Document:
    """Return the document that is validated, for errors with their own location."""
    assert info.context is not None
    document = info.context["document"]
    assert isinstance(document, Document)
    return document


class ExperimentFile(Strict):
    """The file of an experiment; names of files in it are relative to it."""

    #: Description of the file, for errors: ``a study``.
    described_as: ClassVar[str]
    _file: Path = PrivateAttr()

    @model_validator(mode="after")
    def _read_from(self, info: ValidationInfo) -> Self:
        self._file = document_of(info).file
        return self

    @property
    def file(self) -> Path:
        """Path from which it was read."""
        return self._file

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file.

        Raises:
            InputError: a field is wrong, or a file that it names is missing; file and line are
                named.
        """
        document = read_document(path, kind=cls.described_as)
        return document.validated(cls, {"document": document})
