"""Export of a twin, motion or dataset for other programs."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge

from urbantwin.artefact import kind_of
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.exports.frames.shards import ShardSource
    from urbantwin.interface.twin import Twin

__all__ = ["Exported", "export"]

#: Formats of motions, with their default file names.
_OF_MOTIONS = {
    "tracks": "tracks.csv",
    "openlabel": "openlabel.json",
    "openscenario": "traffic.xosc",
}


@dataclass(frozen=True)
class Exported(Artefact):
    """A written export; it can be passed as its file or folder.

    Attributes:
        path: the file or folder.
        to: the format.
        notes: notes for the user.
    """

    path: Path
    to: str
    notes: tuple[str, ...] = ()

    def summary(self) -> Summary:
        """Return format, path and notes."""
        return Summary(format=self.to, written=str(self.path), note=list(self.notes))


@command
def export(
    twin: Twin | AnyPath,
    to: Annotated[str, "FORMAT"],
    out: AnyPath | None = None,
    *,
    version: str | None = None,
    detections: AnyPath | None = None,
    frames: Annotated[int, Ge(1)] = 50,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> Exported:
    """Write a result in another program's format.

    Args:
        twin: twin, motion or dataset, or its folder.
        to: format. For a twin: ``opendrive``, ``carla``, ``sumo``, ``geojson``, ``plan``, ``glb``,
            ``obj``, ``ply``, ``usd``, ``fbx``, ``cityjson``. For a motion: ``tracks`` (CSV),
            ``openlabel``, ``openscenario``. For a dataset: ``openpcdet`` and ``mmdet3d`` (with
            training configs), ``kitti``, ``semantickitti``, ``nuscenes``, ``openlabel``, ``opv2v``,
            ``lumpi``, ``pcd``, ``las``, ``laz``, ``mcap``, ``webdataset``, ``parquet``,
            ``challenge``. For a campaign, a split by scenario or a folder of datasets: shuffled
            shards (``webdataset``, ``parquet``).
        out: file or folder to write; if not given, named after the input, in the current folder.
            ``openpcdet`` with a ``.yaml`` writes the config alone.
        version: version of OpenDRIVE: 1.8, or 1.4 for CARLA; 1.8 if not given.
        detections: for ``challenge``: detections to submit, JSON.
        frames: for ``challenge``: number of frames to submit.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the format, the version or ``out`` cannot be used.

    Example:
        >>> ut.export(twin, "opendrive", "map.xodr")
        >>> ut.export(dataset, "kitti", "kitti/").notes
        $ urbantwin export urbantwin-demo/twin --to opendrive -o map.xodr
    """
    place = None if out is None else Path(out)
    _check_kind(twin, to)
    if to == "challenge":
        from urbantwin.exports.challenge import write_challenge

        folder = place or Path("submission")
        with shown_stage("export", progress, brief=True) as tell:
            tell(0.0, "frames")
            found = None if detections is None else Path(detections)
            notes = write_challenge(Path(twin), folder, frames=frames, detections=found)
        return Exported(folder, to, tuple(notes))
    if to == "openpcdet" and place is not None and place.suffix.lower() in (".yaml", ".yml"):
        from urbantwin.exports.frames.openpcdet import write_openpcdet_config

        return Exported(place, to, tuple(write_openpcdet_config(Path(twin), place)))
    several = _several(Path(twin), to)
    if several:
        from urbantwin.exports.frames.shards import export_shards

        folder = place or Path(f"{Path(twin).resolve().stem}-{to}")
        with shown_stage("export", progress) as tell:
            shards = export_shards(several, to, folder, inputs=[Path(twin)], progress=tell)
        note = f"{shards['frames']} frames of {len(several)} datasets, in an order that was drawn"
        return Exported(folder, to, (note,))
    from urbantwin.exports.frames.formats import DATASET_FORMATS

    if to in DATASET_FORMATS and kind_of(Path(twin)) != "motion":
        from urbantwin.exports.frames import export_dataset

        def tell_loss(text: str) -> None:
            tell_line(f"export: {text}", progress)

        with shown_stage("export", progress) as tell:
            written_to, told = export_dataset(Path(twin), to, place, progress=tell, tell=tell_loss)
        return Exported(written_to, to, tuple(told))
    if to in _OF_MOTIONS:
        from urbantwin.exports.openscenario import write_openscenario
        from urbantwin.exports.tracks import write_openlabel, write_tracks
        from urbantwin.traffic import Motion

        file = place or Path(_OF_MOTIONS[to])
        write = {
            "tracks": write_tracks,
            "openlabel": write_openlabel,
            "openscenario": write_openscenario,
        }[to]
        with shown_stage("export", progress, brief=True) as tell:
            tell(0.0, "reading the motion")
            motion = Motion.load(Path(twin))
            write(motion, file)
        return Exported(file, to)
    from urbantwin.exports import export_twin
    from urbantwin.interface.twin import Twin

    with shown_stage("export", progress, brief=True) as tell:
        tell(0.0, "reading the twin")
        loaded = Twin.open(twin)
        tell(0.2, f"writing {to}")
        written = export_twin(loaded, to, place, version=version)
    return Exported(written.path, to, tuple(written.notes))


def _several(path: Path, to: str) -> list[ShardSource]:
    """Return the datasets of a campaign, split or folder to export as shards, if any."""
    from urbantwin.dataset.reading.datasets import datasets_inside, short_names
    from urbantwin.dataset.split import read_split_document, says_split
    from urbantwin.exports.frames.shards import FORMATS, ShardSource
    from urbantwin.interface.campaign_folder import Campaign, shard_sources

    if to not in FORMATS:
        return []
    if says_split(path):
        rows = read_split_document(path).rows
        names = short_names([folder.resolve() for folder, _, _ in rows])
        return [
            ShardSource(folder, name, part=part)
            for (folder, part, _), name in zip(rows, names, strict=True)
        ]
    if kind_of(path / "index") == "campaign":
        return shard_sources(Campaign.open(path))
    if kind_of(path) is not None:
        return []
    folders = datasets_inside(path) if path.is_dir() else []
    names = short_names([folder.resolve() for folder in folders]) if folders else []
    return [ShardSource(one, name) for one, name in zip(folders, names, strict=True)]


def _check_kind(exported: Twin | AnyPath, to: str) -> None:
    """Check that the format exists and fits the exported kind.

    Raises:
        InputError: it does not; lists the valid formats.
    """
    from urbantwin.exports import FORMATS
    from urbantwin.exports.frames.formats import DATASET_FORMATS

    of: dict[str, tuple[str, ...]] = {
        "twin": tuple(FORMATS),
        "motion": tuple(_OF_MOTIONS),
        "dataset": (*DATASET_FORMATS, "challenge"),
    }
    if not any(to in names for names in of.values()):
        known = ", ".join(dict.fromkeys(name for names in of.values() for name in names))
        raise InputError(f"{to!r} is not a format", place="--to", expected=f"one of {known}")
    kind = kind_of(Path(exported)) if isinstance(exported, str | os.PathLike) else None
    if kind == "fleet" and to not in DATASET_FORMATS:  # list only formats that take a fleet
        of["fleet"] = tuple(name for name, one in DATASET_FORMATS.items() if one.write_fleet)
    if kind in of and to not in of[kind]:
        wanted = next(one for one, names in of.items() if to in names)
        raise InputError(
            f"is a {kind}, and {to} is of a {wanted}",
            file=Path(exported),
            expected=f"of a {kind} one of {', '.join(of[kind])}",
        )
