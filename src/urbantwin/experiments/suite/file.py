"""``suite.yaml`` and the scenarios in the same folder: the cases of a suite."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Self

from pydantic import Field

from urbantwin.errors import InputError
from urbantwin.experiments.fields import Duration, ExperimentFile, NamedFile, Seeds

__all__ = ["Case", "SuiteFile"]

#: The case of traffic without events.
PLAIN = "traffic"


@dataclass(frozen=True)
class Case:
    """One motion of a suite.

    Attributes:
        name: name of the scenario's file without its extension; ``traffic`` without a scenario.
        seed: seed of the traffic.
        scenario: the file; ``None`` for traffic without events.
    """

    name: str
    seed: int
    scenario: Path | None

    @property
    def key(self) -> str:
        """Name that is unique among all cases."""
        return f"{self.name}-seed-{self.seed}"


class SuiteFile(ExperimentFile):
    """A suite: its file, and every other YAML file in its folder, which is a scenario.

    Attributes:
        twin: the twin's folder.
        seconds: length of the motions, seconds; ``None`` for the site's length.
        seeds: seeds of the traffic.
        demand: a file of fields of ``traffic:``.
    """

    described_as: ClassVar[str] = "a suite"

    twin: NamedFile = Field(description="a twin's folder")
    seconds: Duration | None = None
    seeds: Annotated[Seeds, Field(max_length=1000)] = Field(default_factory=lambda: [1])
    demand: NamedFile | None = None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the ``suite.yaml`` of a folder, and find its scenarios.

        Raises:
            InputError: the file is missing, or a field is wrong; file and line are named.
        """
        if not (path / "suite.yaml").is_file():
            raise InputError(
                "holds no suite.yaml",
                file=path,
                expected="a folder with suite.yaml (twin: FOLDER) and scenarios",
            )
        made = super().read(path / "suite.yaml")
        names = [case.key for case in made.cases]
        for case in made.cases:
            if names.count(case.key) > 1:
                raise InputError(
                    f"more than one case is called {case.name!r:.60}",
                    file=path,
                    expected=f"scenarios with names of their own; {PLAIN} is the one without "
                    "events",
                )
        return made

    @property
    def folder(self) -> Path:
        """The folder of the suite."""
        return self.file.parent

    @property
    def expected(self) -> Path:
        """Folder of the accepted results."""
        return self.folder / "expected"

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """The motions, seed by seed, each time first the traffic without events."""
        files = sorted(
            path
            for ending in ("*.yaml", "*.yml")
            for path in self.folder.glob(ending)
            if path not in (self.file, self.demand)
        )
        scenarios: list[tuple[str, Path | None]] = [(PLAIN, None)]
        scenarios += [(path.stem, path) for path in files]
        return tuple(Case(name, seed, file) for seed in self.seeds for name, file in scenarios)
