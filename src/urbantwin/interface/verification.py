"""Whether artefacts are what was written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from urbantwin.artefact import Damage, Verified
from urbantwin.artefact import verify as verify_artefacts
from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary
from urbantwin.processes import usable_processors

__all__ = ["Verification", "verify"]


@dataclass(frozen=True, repr=False)
class Verification:
    """What was found of each artefact.

    Attributes:
        path: what was verified.
        artefacts: folder, kind, number of files and damages of each.
    """

    path: Path
    artefacts: tuple[Verified, ...]

    @property
    def damages(self) -> tuple[Damage, ...]:
        """Every file that is damaged, missing or foreign."""
        return tuple(bad for one in self.artefacts for bad in one.damages)

    def __bool__(self) -> bool:
        """Return whether everything is as it was written."""
        return not self.damages

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
                "wrong": [
                    {"file": bad.name, "is": bad.problem}
                    | ({"where": bad.where} if bad.where else {})
                    for bad in one.damages[:most]
                ],
            }
            for one in self.artefacts
        ]
        return Summary(path=str(self.path), artefacts=rows)

    def check(self) -> None:
        """Refuse what is damaged.

        Raises:
            InputError: a file is damaged, missing or foreign; the first is named.
        """
        first = next((one for one in self.artefacts if one.damages), None)
        if first is None:
            return
        wrong, bad = len(self.damages), first.damages[0]
        raise InputError(
            f"{bad.name} is {bad.problem}"
            + (f" at {bad.where}" if bad.where else "")
            + (f", and {wrong - 1} more are wrong" if wrong > 1 else ""),
            file=first.folder,
            expected="the files as they were written; `urbantwin reproduce` makes a dataset again",
        )


def verify(path: AnyPath, *, progress: ShowProgress = True) -> Verification:
    """Find files of artefacts that are damaged, missing or foreign, by their checksums.

    Args:
        path: an artefact, or a folder of them: what `run` wrote.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: there is no artefact, or its inventory cannot be read.

    Example:
        >>> assert ut.verify("out/")
    """
    from urbantwin.dataset.damaged_file import where_damaged

    with shown_stage("verify", progress) as tell:
        found = verify_artefacts(
            Path(path), workers=usable_processors(), where=where_damaged, progress=tell
        )
    return Verification(Path(path), tuple(found))
