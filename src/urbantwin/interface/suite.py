"""Regression suites: scenarios simulated again, and their changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_file, replaced_file
from urbantwin.errors import StageError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Result, Summary
from urbantwin.progress import Progress, between

if TYPE_CHECKING:
    from urbantwin.experiments.suite.file import Case, SuiteFile
    from urbantwin.experiments.suite.motion_print import MotionPrint
    from urbantwin.interface.twin import Twin
    from urbantwin.traffic import Motion as DrivenMotion

__all__ = ["Suite", "suite"]


@dataclass(frozen=True, repr=False)
class Suite(Result):
    """Outcome of a suite; true if every case equals its accepted result.

    Attributes:
        folder: the suite's folder.
        rows: a row per case: ``case``, ``state`` (``same``, ``changed``, ``new``, ``failed``,
            ``accepted``), and the differences.
        made_with: differences of program, SUMO and twin versions from the accepted results.
        page: the written table.
    """

    folder: Path
    rows: tuple[dict[str, Any], ...]
    made_with: tuple[str, ...]
    page: Path

    def __bool__(self) -> bool:
        """Return whether all cases are the same or accepted."""
        return all(row["state"] in ("same", "accepted") for row in self.rows)

    def __repr__(self) -> str:
        """Return the number of cases by state."""
        return f"Suite of {len(self.rows)} cases: {self._counts()} ({self.folder})"

    def _counts(self) -> str:
        states = [row["state"] for row in self.rows]
        return ", ".join(f"{states.count(one)} {one}" for one in dict.fromkeys(states))

    def summary(self) -> Summary:
        """Return the cases, with the first difference of each changed case."""
        cases = []
        for row in self.rows:
            short = {"case": row["case"], "state": row["state"]}
            if "from_s" in row:
                first = row["first"]
                short["from_s"] = row["from_s"]
                short["first"] = f"{first['class']} {first['track']} {first['change']}"
            for name in ("actors", "events"):
                if name in row:
                    short[f"{name}_that_differ"] = len(row[name])
            if "why" in row:
                short["why"] = row["why"]
            cases.append(short)
        return Summary(
            path=str(self.folder), table=str(self.page), made_with=list(self.made_with), cases=cases
        )

    def check(self) -> None:
        """Raise an error if a case differs from its accepted result.

        Raises:
            StageError: a case differs; names the first.
        """
        if self:
            return
        first = next(row for row in self.rows if row["state"] not in ("same", "accepted"))
        if first["state"] == "new":
            said = "nothing was accepted of it yet (--accept stores what it is)"
        elif "why" in first:
            said = str(first["why"])
        elif "from_s" in first:
            who = first["first"]
            said = f"{who['class']} {who['track']} is {who['change']} from {first['from_s']:g} s on"
        else:
            said = "events or signals differ"
        raise StageError(f"{self.folder}: {self._counts()}; first {first['case']}: {said}")


@command
def suite(
    folder: AnyPath,
    out: AnyPath | None = None,
    *,
    accept: bool = False,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> Suite:
    """Drive scenarios again, and report what changed.

    Args:
        folder: folder with ``suite.yaml`` (``twin``, ``seconds``, ``seeds``) and scenarios.
        out: Markdown table to write; ``changes.md`` in the folder if not given.
        accept: accept the results: store them in ``expected`` of the folder as reference for later
            runs.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the suite, a scenario or the twin cannot be used.
        StageError: SUMO failed, or the disk is full.

    Example:
        >>> ut.experiment.suite("scenarios/").check()
        $ urbantwin experiment suite scenarios/ --accept
    """
    from urbantwin.experiments.suite.accepted import Accepted, table_of
    from urbantwin.experiments.suite.file import SuiteFile
    from urbantwin.experiments.suite.motion_print import changes_between
    from urbantwin.interface.twin import Twin

    described = SuiteFile.read(Path(folder))
    twin = Twin.open(described.twin)
    _scenarios(described, twin)  # check before anything is simulated
    page = Path(out) if out is not None else described.folder / "changes.md"
    check_file(page, kind="suite")
    accepted = Accepted.open(described.expected)
    rows: list[dict[str, Any]] = []
    prints: dict[str, MotionPrint] = {}
    with shown_stage("suite", progress) as tell:
        made_with: dict[str, Any] = {}
        for case, found in _driven(described, twin, tell):
            row: dict[str, Any] = {"case": case.key}
            before = accepted.of(case.key)
            if isinstance(found, str):
                row |= {"state": "failed", "why": found}
            else:
                prints[case.key], made_with = found
                differs = {} if before is None else changes_between(before, prints[case.key])
                state = "new" if before is None else "changed" if differs else "same"
                row |= {"state": state, **differs}
            rows.append(row)
        makers = accepted.differs(made_with)
        gone = sorted(set(accepted.manifest["cases"]) - {row["case"] for row in rows})
        rows += [{"case": key, "state": "gone", "why": "is in the suite no more"} for key in gone]
        text = table_of(rows, makers)
        if accept:
            Accepted.write(described.expected, prints, made_with)
            kept = [row for row in rows if row["state"] != "gone"]
            rows = [row if row["state"] == "failed" else _accepted(row) for row in kept]
        with replaced_file(page, kind="suite") as path:
            path.write_text(text, encoding="utf-8")
    return Suite(described.folder, tuple(rows), tuple(makers), page)


def _accepted(row: dict[str, Any]) -> dict[str, Any]:
    return {**row, "state": "same" if row["state"] == "same" else "accepted"}


def _scenarios(described: SuiteFile, twin: Twin) -> dict[str, list[dict[str, Any]]]:
    """Return the events of the suite's scenarios, by name.

    Raises:
        InputError: a scenario is wrong; names file and line.
    """
    from urbantwin.traffic.events import load_scenario

    until_s = float(described.seconds or twin.site["traffic"]["duration_s"])
    files = {case.name: case.scenario for case in described.cases if case.scenario is not None}
    return {name: load_scenario(file, twin, until_s) for name, file in files.items()}


def _driven(
    described: SuiteFile, twin: Twin, tell: Progress
) -> Iterator[tuple[Case, str | tuple[MotionPrint, dict[str, Any]]]]:
    """Yield each case with the print and versions of its motion, or the reason of its failure."""
    import tempfile

    from urbantwin import __version__
    from urbantwin.experiments.suite.motion_print import MotionPrint
    from urbantwin.site import load_traffic_changes
    from urbantwin.traffic.events import PUT_IN
    from urbantwin.traffic.run import run_traffic, with_more

    scenarios = _scenarios(described, twin)
    changes = {} if described.demand is None else load_traffic_changes(described.demand)
    usual: dict[int, DrivenMotion] = {}
    cases = described.cases
    with tempfile.TemporaryDirectory(prefix="urbantwin-suite-") as scratch:
        for number, case in enumerate(cases):
            told = between(tell, number / len(cases), (number + 1) / len(cases), case.key)
            events = scenarios.get(case.name, [])
            try:
                if events and all(one["event"] in PUT_IN for one in events):
                    motion = with_more(twin, usual[case.seed], events)
                else:
                    motion = run_traffic(
                        twin,
                        Path(scratch) / case.key,
                        seconds=described.seconds,
                        seed=case.seed,
                        changes={**changes, **({"scenario": events} if events else {})},
                        progress=told,
                    )
            except StageError as error:
                if case.scenario is None:
                    raise
                yield case, str(error)
                continue
            if case.scenario is None:
                usual = {case.seed: motion}
            made_with = {
                "urbantwin": __version__,
                "sumo": motion.manifest["sumo"],
                "twin": twin.sha256,
            }
            yield case, (MotionPrint.of(motion), made_with)
