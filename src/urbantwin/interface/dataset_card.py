"""Dataset cards: content, origin and licences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.artefact import check_folder, replaced_folder, write_json
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Result, Summary
from urbantwin.progress import Progress, between

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

__all__ = ["Card", "card"]


@dataclass(frozen=True, repr=False)
class Card(Result):
    """Written cards.

    Attributes:
        path: the described path.
        files: the cards, Markdown.
    """

    path: Path
    files: tuple[Path, ...]

    def __str__(self) -> str:
        """Return the text of the last card; for several sensors, that of the whole."""
        return self.files[-1].read_text(encoding="utf-8")

    def __repr__(self) -> str:
        """Return the paths of the cards."""
        return f"Card of {self.path}: {', '.join(map(str, self.files))}"

    def summary(self) -> Summary:
        """Return the paths of the cards."""
        return Summary(path=str(self.path), cards=[str(one) for one in self.files])


@command
def card(
    path: AnyPath,
    out: AnyPath | None = None,
    *,
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Card:
    """Write a dataset's card, with pictures and licences.

    Uses the manifest and the tables. `record` writes a card into every dataset; this command writes
    it again, for datasets of earlier versions, or into another folder.

    Args:
        path: dataset, exported dataset, or a folder of them.
        out: folder to write, in which an older card is replaced; the dataset itself if not given.
        pictures: draw the pictures that are missing.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: there is no dataset, a file of it is damaged, its card was changed by hand, or
            ``out`` holds other files.
        StageError: the disk is full.

    Example:
        >>> print(ut.dataset.card("out/dataset"))
        $ urbantwin dataset card urbantwin-demo/dataset
    """
    from urbantwin.dataset.card import carded_folders, renewed_folder, write_cards, write_index

    source, place = Path(path), None if out is None else Path(out)
    folders = carded_folders(source)
    if place is not None:
        check_folder(place, kind="card", inputs=list(folders))
    files: list[Path] = []
    with shown_stage("card", progress) as tell:
        if place is None:
            for number, (folder, kind) in enumerate(folders.items()):
                share = between(tell, number / len(folders), (number + 1) / len(folders))
                with renewed_folder(folder, kind) as scratch:
                    if pictures and kind == "dataset":
                        _draw(scratch, scratch, share)
                    made = write_cards(scratch, kind)
                files += _there(made, scratch, folder)
        else:
            with _card_folder(place, list(folders)) as scratch:
                for folder, kind in folders.items():
                    own = scratch if len(folders) == 1 else scratch / folder.name
                    if pictures and kind == "dataset":
                        _draw(folder, own, tell)
                    files += _there(write_cards(folder, kind, own), scratch, place)
                datasets = [folder for folder, kind in folders.items() if kind == "dataset"]
                if len(folders) > 1 and datasets:
                    files += _there([write_index(source, datasets, scratch)], scratch, place)
                write_json(scratch / "card.json", {"kind": "card", "cards": len(files)})
        tell(1.0, "done")
    return Card(source, tuple(files))


def _card_folder(place: Path, inputs: list[Path]) -> AbstractContextManager[Path]:
    return replaced_folder(place, kind="card", inputs=inputs)


def _there(made: Iterable[Path], scratch: Path, place: Path) -> list[Path]:
    """Return the final paths of files in the scratch folder."""
    return [place / one.relative_to(scratch) for one in made]


def _draw(dataset: Path, to: Path, tell: Progress) -> None:
    """Draw the missing pictures of a dataset into a folder."""
    from urbantwin.dataset import parts_of
    from urbantwin.dataset.card import PICTURES
    from urbantwin.drawing.pictures import pictures_of_dataset

    for part in parts_of(dataset):
        own = to / part.relative_to(dataset) / "pictures"
        drawn = [own / name for name in PICTURES if name != "scene.png"]
        if not all(one.is_file() for one in drawn):
            for one in drawn:
                one.unlink(missing_ok=True)  # hard link to the older dataset's file
            pictures_of_dataset(part, own, progress=between(tell, 0.0, 0.9))
