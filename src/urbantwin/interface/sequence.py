"""Sequence files: actors and sensors of a dataset over its frames."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from urbantwin.artefact import check_folder, read_json, replaced_folder, sha256_of, write_json
from urbantwin.artefact.arrays import read_array
from urbantwin.artefact.manifest import Part, validated
from urbantwin.dataset.reading.columns import LANES_FILE, SEQUENCE_TABLES, TRAJECTORIES_FILE
from urbantwin.dataset.reading.tables import read_table
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.interface.dataset import Dataset

__all__ = ["SequenceFiles", "sequence"]

_FLOW = "the flow of a frame: (N, 3) float32"
LAYOUT = {
    "tracks": "tracks.parquet: one row per track: who it is, its first and last frame",
    "tracklets": "tracklets.parquet: one row per track and frame: its box, site frame",
    "trajectories": "trajectories.parquet: one row per track and step of the motion, site frame",
    "poses": "poses.parquet: where the ego and each sensor were, site frame",
    "lanes": "lanes.parquet: one row per lane of the twin: its middle, site frame",
    "flow": "flow/NAME.npy: (N, 3) float32, metres: where each point of a frame goes until the "
    "next frame sees it; not a number where nobody knows it",
}


class _Manifest(Part):
    kind: Literal["sequence"]
    frames: Annotated[int, Field(ge=0)]
    tracks: Annotated[int, Field(ge=0)]
    trajectories: bool
    flow: bool
    ego_motion: bool


class SequenceFiles(Artefact):
    """Files that `sequence` wrote; it can be passed as its folder.

    Attributes:
        folder: the folder.
        manifest: content of ``sequence.json``.
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        file = self.folder / "sequence.json"
        self.manifest: dict[str, Any] = read_json(file, kind="sequence")
        validated(self.manifest, _Manifest, file=file, expected="a sequence's manifest")

    @classmethod
    def open(cls, folder: AnyPath) -> SequenceFiles:
        """Open a folder.

        Raises:
            InputError: the folder was not written by `sequence`.
        """
        return cls(folder)

    @cached_property
    def tracks(self) -> pa.Table:
        """One row per track."""
        return self._table("tracks")

    @cached_property
    def tracklets(self) -> pa.Table:
        """One row per track and frame that labels it."""
        return self._table("tracklets")

    @cached_property
    def trajectories(self) -> pa.Table:
        """One row per track and step of the motion."""
        return self._table("trajectories")

    @cached_property
    def poses(self) -> pa.Table:
        """One row per frame and ego or turn of a sensor."""
        return self._table("poses")

    @cached_property
    def lanes(self) -> pa.Table:
        """One row per lane of the twin."""
        return self._table("lanes")

    def flow(self, frame: str) -> NDArray[np.float32]:
        """Return the flow (N, 3) of a frame's points, by the frame's name.

        Raises:
            InputError: the flow was not written, or is damaged.
        """
        path = self.folder / "flow" / f"{frame}.npy"
        found: NDArray[np.float32] = read_array(path, _FLOW)
        if found.ndim != 2 or found.shape[1] != 3 or found.dtype != np.float32:
            raise InputError(f"holds {found.dtype} {found.shape}", file=path, expected=_FLOW)
        return found

    def _table(self, name: str) -> pa.Table:
        return read_table(self.folder / f"{name}.parquet")

    def __repr__(self) -> str:
        """Return the numbers of tracks and frames, and the folder."""
        return (
            f"Sequence of {self.manifest['tracks']} tracks in {self.manifest['frames']} frames "
            f"({self.folder})"
        )

    def summary(self) -> Summary:
        """Return the counts and options."""
        told = ("kind", "frames", "tracks", "trajectories", "flow", "ego_motion")
        return Summary(path=str(self.folder), **{name: self.manifest[name] for name in told})


@command
def sequence(
    dataset: AnyPath,
    out: AnyPath | None = None,
    *,
    motion: AnyPath | None = None,
    flow: bool = False,
    ego: bool = False,
    csv: bool = False,
    progress: ShowProgress = True,
) -> SequenceFiles:
    """Write tracks, trajectories, poses and scene flow.

    A dataset recorded by this version already has the four tables. This command makes them for an
    older dataset, and also writes CSV tables and the flow of every point.

    Args:
        dataset: dataset, or its folder.
        out: folder to write; ``sequence`` beside the dataset if not given.
        motion: motion of the dataset, for trajectories that an older dataset lacks.
        flow: write the displacement of each point until the next frame.
        ego: include the motion of the sensor in the flow, as Argoverse 2 does.
        csv: write each table as CSV as well.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: not a dataset, one dataset per sensor, or another motion.

    Example:
        >>> ut.dataset.sequence("out/dataset", flow=True).flow("000003")
        $ urbantwin dataset sequence urbantwin-demo/dataset -o sequence/ --csv
    """
    from urbantwin.dataset.sequence_tables import write_sequence_tables
    from urbantwin.dataset.trajectories import paths_of_trajectories
    from urbantwin.interface.dataset import Dataset
    from urbantwin.progress import each

    if ego and not flow:
        raise InputError("goes with the flow", place="--ego", expected="--flow, too")
    source = Path(dataset)
    place = beside(source, "sequence", out)
    given = None if motion is None else Path(motion)
    inputs = [source, given]
    check_folder(place, kind="sequence", inputs=inputs)
    frames = Dataset(source)
    if frames.parts:
        raise InputError(
            "holds a dataset for each sensor",
            file=source,
            expected=f"one of them: {source / next(iter(frames.parts))}",
        )
    number = len(frames)
    driven = None if given is None else _motion_of(frames, given)
    manifest_file = source / "dataset.json"
    asked = {"flow": flow, "ego_motion": ego, "csv": csv, "motion": driven is not None}
    told = json.dumps([sha256_of(manifest_file), asked], sort_keys=True)
    key = hashlib.sha256(told.encode()).hexdigest()[:16]
    with (
        shown_stage("sequence", progress, brief=True) as tell,
        replaced_folder(place, kind="sequence", inputs=inputs, key=key) as folder,
    ):
        tell(0.0, "tables")
        write_sequence_tables(folder, frames.manifest, source, driven)
        for name in (TRAJECTORIES_FILE, LANES_FILE):  # not derived from boxes and sweeps
            if not (folder / name).is_file() and (source / name).is_file():
                read_table(source / name)  # raises an error if damaged
                (folder / name).write_bytes((source / name).read_bytes())
        there = [name for name in SEQUENCE_TABLES if (folder / name).is_file()]
        if csv:
            for name in there:
                if name != LANES_FILE:  # list columns do not fit into CSV
                    _write_csv(folder / name)
        if flow:
            (folder / "flow").mkdir(exist_ok=True)
            if driven is not None:  # the dataset itself may lack them
                frames.paths = paths_of_trajectories(read_table(folder / TRAJECTORIES_FILE))
            for k in each(range(number), tell, "flow"):
                file = folder / "flow" / f"{frames.names[k]}.npy"
                if not file.is_file():  # files left by an interrupted run are complete
                    _save(file, frames[k].flow(ego=ego))
        write_json(
            folder / "sequence.json",
            {
                "kind": "sequence",
                "dataset_sha256": sha256_of(manifest_file),
                "frames": number,
                "tracks": read_table(folder / SEQUENCE_TABLES[0]).num_rows,
                "trajectories": TRAJECTORIES_FILE in there,
                "flow": flow,
                "ego_motion": flow and ego,
                "layout": {
                    name: text
                    for name, text in LAYOUT.items()
                    if f"{name}.parquet" in there or (name == "flow" and flow)
                },
            },
        )
    return SequenceFiles(place)


def _motion_of(frames: Dataset, folder: Path) -> Any:  # noqa: ANN401 - imports what makes motions
    from urbantwin.traffic import Motion
    from urbantwin.traffic.fingerprint import table_sha256

    motion = Motion.load(folder)
    if table_sha256(motion.rows) != frames.manifest.get("motion_sha256"):
        raise InputError(
            "has other actors", file=folder, expected="the motion that the dataset was recorded of"
        )
    return motion


def _write_csv(table: Path) -> None:
    import pyarrow.csv

    pyarrow.csv.write_csv(read_table(table), table.with_suffix(".csv"))


def _save(file: Path, flow: NDArray[np.float32]) -> None:
    """Write a file atomically."""
    part = file.with_suffix(".part")
    with part.open("wb") as stream:
        np.save(stream, flow)
    part.replace(file)
