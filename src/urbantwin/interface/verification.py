"""Verification of artefacts against their checksums."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from urbantwin.artefact import Damage, Verified
from urbantwin.artefact import verify as verify_artefacts
from urbantwin.artefact.privacy import Finding, names_here, search_files
from urbantwin.artefact.verify import is_artefact
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Result, Summary
from urbantwin.processes import usable_processors
from urbantwin.progress import between

__all__ = ["Verification", "verify"]


#: Largest number of files listed per artefact in text.
_LISTED = 20


@dataclass(frozen=True, repr=False)
class Verification(Result):
    """Outcome of a verification.

    Attributes:
        path: the verified path.
        artefacts: folder, kind, number of files and damages of each artefact.
        personal: findings of personal data; ``None`` if not searched.
    """

    path: Path
    artefacts: tuple[Verified, ...]
    personal: tuple[Finding, ...] | None = None

    @property
    def damages(self) -> tuple[Damage, ...]:
        """All damaged, missing or foreign files."""
        return tuple(bad for one in self.artefacts for bad in one.damages)

    def __bool__(self) -> bool:
        """Return whether all files are as written, without personal data."""
        return not self.damages and not self.personal

    def __repr__(self) -> str:
        """Return counts and the path."""
        files = sum(one.files for one in self.artefacts)
        told = "" if self.personal is None else f", {len(self.personal)} say something of people"
        return (
            f"{files} files of {len(self.artefacts)} artefacts verified, {len(self.damages)} "
            f"are wrong{told} ({self.path})"
        )

    def summary(self, most: int | None = None) -> Summary:
        """Return the problems, artefact by artefact.

        Args:
            most: largest number of files listed per artefact; all if not given.
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
        found = Summary(path=str(self.path), artefacts=rows)
        if self.personal is not None:
            found["personal_findings"] = len(self.personal)  # 0 is reported as well
            found["personal_data"] = [asdict(one) for one in self.personal[:most]]
        return found

    def text(self) -> str:
        """Return the text that a command prints: the first files of each artefact."""
        return str(self.summary(_LISTED))

    def check(self) -> None:
        """Raise an error for damaged files or personal data.

        Raises:
            InputError: a file is damaged, missing or foreign, or holds personal data; names the
                first.
        """
        first = next((one for one in self.artefacts if one.damages), None)
        if first is None:
            self._check_personal()
            return
        wrong, bad = len(self.damages), first.damages[0]
        raise InputError(
            f"{bad.name} is {bad.problem}"
            + (f", and {wrong - 1} more are wrong" if wrong > 1 else ""),
            file=first.folder,
            expected="the files as written; `urbantwin dataset reproduce` makes a dataset again",
        )

    def _check_personal(self) -> None:
        if self.personal:
            one, others = self.personal[0], len(self.personal) - 1
            raise InputError(
                f"{one.what} ({one.text})" + (f", and {others} more findings" if others else ""),
                file=self.path / one.file if self.path.is_dir() else self.path,
                place=one.place,
                expected="nothing of people, machines or moments; look whether it may be passed on",
            )


@command
def verify(
    path: AnyPath,
    *,
    privacy: bool = False,
    progress: ShowProgress = True,
) -> Verification:
    """Check all files of a result against their checksums.

    Args:
        path: result, or a folder of results (of ``run``, a campaign or an export to CARLA); with
            ``privacy`` any file or folder.
        privacy: also search all files for personal data: absolute paths, names of users and
            machines, e-mail addresses and time stamps, in texts and in the metadata of known
            formats.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: there is no artefact, or its inventory cannot be read.

    Example:
        >>> assert ut.dataset.verify("out/")
        $ urbantwin dataset verify urbantwin-demo/
    """
    place, found, personal = Path(path), list[Verified](), None
    with shown_stage("verify", progress) as tell:
        if not privacy or is_artefact(place):
            found = verify_artefacts(
                place,
                workers=usable_processors(),
                progress=between(tell, 0.0, 0.5) if privacy else tell,
            )
        if privacy:
            personal = tuple(
                search_files(place, names=names_here(), progress=between(tell, 0.5, 1.0))
            )
    return Verification(place, tuple(found), personal)
