"""``suite.yaml`` and the scenarios beside it: what is driven."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from urbantwin.errors import InputError
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import must_exist, read_document

__all__ = ["Case", "SuiteFile", "load_suite"]

#: The case of traffic without events.
PLAIN = "traffic"


class _Fields(Strict):
    twin: Annotated[str, Field(description="a twin's folder")]
    seconds: Annotated[float, Field(ge=0.1, le=86400.0, allow_inf_nan=False)] | None = None
    seeds: list[Annotated[int, Field(ge=0, lt=2**31)]] = Field(
        default_factory=lambda: [1], min_length=1, max_length=1000
    )
    demand: str | None = None


@dataclass(frozen=True)
class Case:
    """One motion of a suite.

    Attributes:
        name: of the scenario's file without its ending; ``traffic`` for none.
        seed: of the traffic.
        scenario: the file; ``None`` for traffic without events.
    """

    name: str
    seed: int
    scenario: Path | None

    @property
    def key(self) -> str:
        """Its name among all cases."""
        return f"{self.name}-seed-{self.seed}"


@dataclass(frozen=True)
class SuiteFile:
    """A suite.

    Attributes:
        folder: where it is.
        twin: the twin's folder.
        seconds: length of the motions; ``None`` for the site's.
        demand: a file of fields of ``traffic:``.
        cases: seed by seed, each time first the traffic without events.
    """

    folder: Path
    twin: Path
    seconds: float | None
    demand: Path | None
    cases: tuple[Case, ...]

    @property
    def expected(self) -> Path:
        """Where what was accepted is."""
        return self.folder / "expected"


def load_suite(folder: Path) -> SuiteFile:
    """Read a folder's ``suite.yaml``; every other YAML file in it is a scenario.

    Raises:
        InputError: there is none, or a field is wrong; file and line are named.
    """
    file = folder / "suite.yaml"
    if not file.is_file():
        raise InputError(
            "holds no suite.yaml",
            file=folder,
            expected="a folder with suite.yaml (twin: FOLDER) and scenarios",
        )
    document = read_document(file, kind="a suite")
    fields = document.validated(_Fields)
    if len(set(fields.seeds)) < len(fields.seeds):
        raise document.error("names a seed twice", ["seeds"], "each seed once")
    found = {}
    for name in ("twin", "demand"):
        given = getattr(fields, name)
        if given is not None:
            must_exist(document, (name,), folder / given, "a name beside the suite's", folders=True)
        found[name] = None if given is None else folder / given
    scenarios = sorted(
        path
        for ending in ("*.yaml", "*.yml")
        for path in folder.glob(ending)
        if path.name != file.name and path != found["demand"]
    )
    names = [path.stem for path in scenarios]
    for name in names:
        if name == PLAIN or names.count(name) > 1:
            raise InputError(
                f"more than one case is called {name!r:.60}",
                file=folder,
                expected=f"scenarios with names of their own; {PLAIN} is the one without events",
            )
    cases = [
        Case(name, seed, scenario)
        for seed in fields.seeds
        for name, scenario in [(PLAIN, None), *zip(names, scenarios, strict=True)]
    ]
    assert found["twin"] is not None
    return SuiteFile(folder, found["twin"], fields.seconds, found["demand"], tuple(cases))
