"""Whether artefacts are what was written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.artefact import Damage, Verified
from urbantwin.artefact import verify as verify_artefacts
from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary
from urbantwin.processes import usable_processors

if TYPE_CHECKING:
    from urbantwin.exports.carla.check import Finding

__all__ = ["Verification", "verify"]


@dataclass(frozen=True, repr=False)
class Verification:
    """What was found of each artefact.

    Attributes:
        path: what was verified.
        artefacts: folder, kind, number of files and damages of each.
        carla: of each undamaged CARLA package, by its folder, the rules of CARLA's own code and
            what of the package breaks them.
    """

    path: Path
    artefacts: tuple[Verified, ...]
    carla: Mapping[Path, tuple[Finding, ...]] = field(default_factory=dict)

    @property
    def damages(self) -> tuple[Damage, ...]:
        """Every file that is damaged, missing or foreign."""
        return tuple(bad for one in self.artefacts for bad in one.damages)

    def __bool__(self) -> bool:
        """Return whether everything is as it was written, and as CARLA asks for it."""
        broken = any(one.problems for found in self.carla.values() for one in found)
        return not self.damages and not broken

    def __repr__(self) -> str:
        """Return counts and the path."""
        files = sum(one.files for one in self.artefacts)
        return (
            f"{files} files of {len(self.artefacts)} artefacts verified, {len(self.damages)} "
            f"are wrong ({self.path})"
        )

    def summary(self, most: int | None = None) -> Summary:
        """Return what is wrong, artefact by artefact.

        Args:
            most: files that are named of each; all if not given.
        """
        rows = [
            {
                "path": str(one.folder),
                "kind": one.kind,
                "files": one.files,
                "wrong": [{"file": bad.name, "is": bad.problem} for bad in one.damages[:most]],
            }
            for one in self.artefacts
        ]
        if not self.carla:
            return Summary(path=str(self.path), artefacts=rows)
        from urbantwin.exports.carla.check import NOT_PROVEN

        rules = [
            {"package": folder.name, "rule": one.rule, "read_by": one.read_by, "found": told}
            for folder, found in self.carla.items()
            for one in found
            for told in one.told(most)
        ]
        return Summary(path=str(self.path), artefacts=rows, carla=rules, not_proven=NOT_PROVEN)

    def check(self) -> None:
        """Refuse what is damaged, or what CARLA would trip over.

        Raises:
            InputError: a file is damaged, missing or foreign, or breaks a rule; the first is named.
        """
        first = next((one for one in self.artefacts if one.damages), None)
        if first is None:
            for folder, found in self.carla.items():
                problems = [f"{one.rule}: {bad}" for one in found for bad in one.problems]
                if problems:
                    more = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
                    expected = "a package by CARLA's rules (docs/exports.md)"
                    raise InputError(f"{problems[0]}{more}", file=folder, expected=expected)
            return
        wrong = len(self.damages)
        raise InputError(
            f"{first.damages[0].name} is {first.damages[0].problem}"
            + (f", and {wrong - 1} more are wrong" if wrong > 1 else ""),
            file=first.folder,
            expected="the files as they were written; `urbantwin reproduce` makes a dataset again",
        )


def verify(path: AnyPath, *, progress: ShowProgress = True) -> Verification:
    """Find files of artefacts that are damaged, missing or foreign, by their checksums.

    A package for CARLA is also put before the rules of CARLA's own import, server and tools; those
    about lanes and signals need its Python package.

    Args:
        path: an artefact, or a folder of them: what `run` wrote, or `export` to CARLA.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: there is no artefact, or its inventory cannot be read.

    Example:
        >>> assert ut.verify("out/")
    """
    with shown_stage("verify", progress) as tell:
        found = verify_artefacts(Path(path), workers=usable_processors(), progress=tell)
        carla = {}
        for one in found:
            if one.kind == "carla" and not one.damages:
                from urbantwin.exports.carla.check import check_package

                carla[one.folder] = check_package(one.folder)
    return Verification(Path(path), tuple(found), carla)
