"""Datasets and fleets on disk: reading, summaries, pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from urbantwin.dataset.reading import dataset, datasets, fleet
from urbantwin.dataset.split import PARTS
from urbantwin.interface.outcome import outcome_of_dataset
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Dataset", "Datasets", "Fleet"]


class Dataset(Artefact, dataset.Dataset):
    """A dataset on disk: its frames in order of time.

    It can be passed as its folder. A rig whose sensors are not fused gives one dataset per sensor,
    in `parts`; the dataset itself then has no frames.

    Attributes:
        folder: its folder.
        manifest: content of ``dataset.json``.

    Example:
        >>> dataset = ut.open("out/dataset")
        >>> dataset[0].points.shape, dataset.boxes.num_rows
        >>> dataset.plot(3).savefig("frame.png")
    """

    def summary(self) -> Summary:
        """Return the dataset's content in brief."""
        from urbantwin.dataset.description import describe

        return Summary(
            path=str(self.folder),
            **describe(self.folder),
            **outcome_of_dataset(self),
            warnings=[str(one) for one in self.warnings],
        )

    def plot(self, frame: int | str | None = None, picture: str = "birdseye") -> Figure:
        """Draw a frame, or a histogram of points and boxes per class.

        Args:
            frame: number or name of the frame; without it, the frame with the most labelled actors.
            picture: ``birdseye``, from above with boxes; ``range_image``, of the sensor nearest to
                the centre of the points; or ``histogram``, of all frames.

        Raises:
            InputError: the frame or picture does not exist.
        """
        from urbantwin.drawing.pictures import figure_of_dataset

        self.check_single()
        name = frame if frame is None or isinstance(frame, str) else self[frame].name
        return figure_of_dataset(self.folder, name, picture)


class Datasets(datasets.Datasets):
    """Several datasets as one: an index over their frames, without copying.

    With unfused sensors, each sensor's dataset counts as one. A sequence is named by the folder of
    its dataset, and by parent folders as far as needed for unique names.

    Args:
        paths: folders of datasets.

    Raises:
        InputError: a path is not a dataset, or no path is given.

    Example:
        >>> both = ut.Datasets(["dry/dataset", "rain/dataset"])
        >>> both.where(sequences=["rain/dataset"], classes=["car"])
        >>> ut.Datasets.open("split.json").where(split="train")
    """

    dataset_type = Dataset

    def summary(self) -> Summary:
        """Return the number of frames per dataset, and per part of a split."""
        pairs = zip(self._names, self._datasets, strict=True)
        told = Summary(frames=len(self), datasets={name: len(one.names) for name, one in pairs})
        if self._divided is not None:
            parts = {part for _, part, _ in self._divided.rows}
            told["parts"] = {part: len(self.where(split=part)) for part in PARTS if part in parts}
        return told


class Fleet(Artefact, fleet.Fleet):
    """A fleet of nodes on disk: a dataset per node, common labels, and the nodes' poses over time.

    It can be passed as its folder.

    Attributes:
        folder: its folder.
        manifest: content of ``fleet.json``.
        node_names: names of the nodes.
        names: names of the frames, in order of time.
        times_s: (F,) their times, seconds from the motion's start.

    Example:
        >>> fleet = ut.record(twin, motion, nodes="nodes.yaml")
        >>> fleet.nodes["bus"][0].points, fleet.frame(0).boxes
        >>> fleet.frame(12).fused(frame_of="pole", using="reported").points
    """

    dataset_type = Dataset

    def plot(self, frame: int | str | None = None) -> Figure:
        """Draw a frame from above: the points of each node, and the nodes that see each actor.

        Args:
            frame: number or name of the frame; without it, the frame with the most actors that
                several nodes see.

        Raises:
            InputError: the frame does not exist.
        """
        from urbantwin.drawing.fleet import figure_of_fleet
        from urbantwin.drawing.pictures import attributions

        name = None if frame is None else self.frame(frame).name
        return figure_of_fleet(self, name, attributions(self.manifest))

    def summary(self) -> Summary:
        """Return the fleet's content in brief."""
        told = self.manifest
        boxes = self.boxes
        seen = boxes["num_nodes"].to_numpy()
        return Summary(
            path=str(self.folder),
            kind="fleet",
            made_with=f"urbantwin {told['urbantwin']}",
            frames=len(self),
            time_s=f"{self.times_s[0]:g} to {self.times_s[-1]:g}",
            rate_hz=told["rate_hz"],
            nodes={
                one["name"]: {
                    "rides": one["carrier"] if one["rides"] else None,
                    "sensors": [f"{row['name']} ({row['model']})" for row in one["sensors"]],
                    "frames": one["frames"],
                    "absent": one["frames_absent"],
                    "lost": one["frames_lost"],
                    "points": one["points"],
                }
                for one in told["nodes"]
            },
            boxes=len(seen),
            boxes_seen_by_one=int((seen == 1).sum()),
            boxes_seen_by_more=int((seen > 1).sum()),
            warnings=[str(one) for one in self.warnings],
        )
