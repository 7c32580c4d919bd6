"""Export of a dataset to another format, atomically."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from urbantwin import __version__
from urbantwin.artefact import (
    check_file,
    check_folder,
    kind_of,
    read_json,
    replaced_file,
    replaced_folder,
    sha256_of,
    write_json,
)
from urbantwin.dataset import parts_of
from urbantwin.dataset.reading import Fleet
from urbantwin.errors import InputError
from urbantwin.exports.frames.formats import DATASET_FORMATS, DatasetFormat
from urbantwin.exports.frames.losses import losses_of
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress, untold

__all__ = ["export_dataset"]

#: Kind of the written folder; a later export may replace it.
KIND = "exported"


def export_dataset(
    dataset: Path,
    to: str,
    out: Path | None = None,
    *,
    progress: Progress = untold,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Path, list[str]]:
    """Write a dataset in another format.

    Args:
        dataset: folder of the dataset.
        to: one of `DATASET_FORMATS`.
        out: folder or file to write; if not given, named after the dataset, in the current folder.
        progress: called with the fraction done and a description.
        tell: called with each loss of the format, a sentence, before anything is written.

    Returns:
        The written path, and notes for the user, losses first.

    Raises:
        InputError: the format is unknown, the dataset is damaged, or ``out`` cannot be used.
    """
    if to not in DATASET_FORMATS:
        names = ", ".join(DATASET_FORMATS)
        raise InputError(f"{to!r} is not a format", place="--to", expected=f"one of {names}")
    wanted = DATASET_FORMATS[to]
    fleet = Fleet(dataset) if kind_of(dataset) == "fleet" else None
    sources = _opened(dataset, wanted) if fleet is None else _nodes(fleet, wanted)
    path = out or Path(f"{dataset.resolve().name}{wanted.ending or '-' + to}")
    if wanted.ending:
        check_file(path, kind=to, inputs=[dataset])
    else:
        check_folder(path, kind=KIND, inputs=[dataset])
        _check_format(path, to)
    losses = _losses_of_all(sources, fleet, wanted)
    for one in losses:
        tell(one)
    if wanted.ending:
        with replaced_file(path, kind=to, inputs=[dataset]) as scratch:
            notes = _written(sources, fleet, wanted, scratch, progress)
        return path, [*losses, *notes]
    with replaced_folder(path, kind=KIND, inputs=[dataset]) as folder:
        notes = _written(sources, fleet, wanted, folder, progress)
        write_json(
            folder / f"{KIND}.json",
            {
                "kind": KIND,
                "format": to,
                "urbantwin": __version__,
                "dataset_sha256": sha256_of(
                    dataset / ("dataset.json" if fleet is None else "fleet.json")
                ),
                "inputs": sources[0].manifest["inputs"],
                "losses": losses,
                "notes": list(notes),
            },
        )
    return path, [*losses, *notes]


def _check_format(folder: Path, to: str) -> None:
    """Check that a folder holds no export in another format.

    Raises:
        InputError: it holds one.
    """
    if kind_of(folder) == KIND:
        older = read_json(folder / f"{KIND}.json", kind=KIND).get("format")
        if older != to:
            raise InputError(
                f"holds an export to {older!r:.40}", file=folder, expected="another folder"
            )


def _opened(dataset: Path, wanted: DatasetFormat) -> list[FrameSource]:
    """Return a dataset, or those of each sensor if the format supports several.

    Raises:
        InputError: not a dataset, or the format supports a single one only.
    """
    parts = parts_of(dataset)
    if len(parts) > 1 and wanted.write_parts is not None:
        return [FrameSource(part) for part in parts]
    return [FrameSource(dataset)]


def _nodes(fleet: Fleet, wanted: DatasetFormat) -> list[FrameSource]:
    """Return the datasets of a fleet's nodes, if the format supports fleets.

    Raises:
        InputError: it does not.
    """
    if wanted.write_fleet is None:
        takes = ", ".join(name for name, one in DATASET_FORMATS.items() if one.write_fleet)
        raise InputError(
            f"is a fleet, of which {wanted.name} has no notion",
            file=fleet.folder,
            expected=f"one of its nodes ({', '.join(fleet.node_names)}), or --to {takes}",
        )
    return [FrameSource(fleet.folder_of(name)) for name in fleet.node_names]


def _losses_of_all(
    sources: Sequence[FrameSource], fleet: Fleet | None, wanted: DatasetFormat
) -> list[str]:
    """Return the losses of all datasets, with the node's name for those of some nodes only."""
    lost = [_losses(source, wanted) for source in sources]
    if fleet is None:
        return list(dict.fromkeys(one for own in lost for one in own))
    told = []
    for node, own in zip(fleet.node_names, lost, strict=True):
        told += [one if all(one in other for other in lost) else f"{node}: {one}" for one in own]
    told.append(f"{wanted.name} cannot hold of nodes: clocks, what came late or never arrived")
    return list(dict.fromkeys(told))


def _losses(source: FrameSource, wanted: DatasetFormat) -> list[str]:
    return [*losses_of(source, wanted.name, wanted.holds), *wanted.losses_besides(source)]


def _written(
    sources: Sequence[FrameSource],
    fleet: Fleet | None,
    wanted: DatasetFormat,
    to: Path,
    progress: Progress,
) -> Sequence[str]:
    if fleet is not None:
        assert wanted.write_fleet is not None
        return wanted.write_fleet(fleet, to, progress)
    if len(sources) > 1 and wanted.write_parts is not None:
        return wanted.write_parts(sources, to, progress)
    return wanted.write(sources[0], to, progress)
