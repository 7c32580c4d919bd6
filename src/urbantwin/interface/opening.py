"""Opening of files and folders of any kind."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import kind_of, read_json
from urbantwin.artefact.storage import is_url
from urbantwin.dataset.split import says_split
from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.interface.coverage_map import Coverage
    from urbantwin.interface.dataset import Dataset
    from urbantwin.interface.motion import Motion
    from urbantwin.interface.report import Report
    from urbantwin.interface.tuning import Tuning
    from urbantwin.interface.twin import Twin

__all__ = ["Package", "open", "opened_artefact"]

#: Module and class of each kind of artefact; other kinds are for other programs.
_CLASSES = {
    "twin": ("twin", "Twin"),
    "motion": ("motion", "Motion"),
    "dataset": ("dataset", "Dataset"),
    "report": ("report", "Report"),
    "coverage": ("coverage_map", "Coverage"),
    "tuning": ("tuning", "Tuning"),
    "sequence": ("sequence", "SequenceFiles"),
    "fleet": ("dataset", "Fleet"),
    "study": ("study", "Study"),
    "campaign": ("campaign_folder", "Campaign"),
    "explanation": ("explanation", "Explanation"),
    "fusion": ("fusion_study", "FusionStudy"),
    "placement": ("placement", "Placement"),
}
_EXPECTED = (
    "a folder that urbantwin wrote; a site.yaml, a rig.yaml or a sensor; a measured background "
    "(.npz); a cloud, or a folder of real frames"
)


class Package(Artefact):
    """An artefact for another program: a submission, a package for SUMO or CARLA, a plan, ...

    Attributes:
        folder: the folder.
        kind: kind of the artefact.
        manifest: content of its ``KIND.json``.
    """

    def __init__(self, folder: AnyPath, kind: str) -> None:
        self.folder = Path(folder)
        self.kind = kind

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Content of its ``KIND.json``."""
        return read_json(self.folder / f"{self.kind}.json", kind=self.kind)

    @property
    def files(self) -> list[Path]:
        """Paths of its files."""
        return sorted(path for path in self.folder.rglob("*") if path.is_file())

    def __repr__(self) -> str:
        """Return kind, number of files and folder."""
        return f"Package {self.kind} of {len(self.files)} files ({self.folder})"

    def summary(self) -> Summary:
        """Return its kind and its files."""
        names = [path.relative_to(self.folder).as_posix() for path in self.files]
        return Summary(path=str(self.folder), kind=self.kind, files=names)


def open(path: AnyPath) -> Any:  # noqa: ANN401 - its type is that of what is there
    """Open a result, an input file or a recording.

    Args:
        path: a folder that a command wrote (or a manifest in it: ``out/twin/twin.json``), a folder
            with a twin, a motion and a dataset; a ``site.yaml``, a ``rig.yaml``, a ``nodes.yaml``
            or a sensor's file; a measured background; a cloud, or real frames in any known layout
            (one sensor of a bag or capture: ``a.bag:/lidar/points``, ``a.pcap:192.168.1.201``). Or
            the URL of a stored dataset: ``s3://bucket/dataset``.

    Returns:
        A `Twin`, `Motion`, `Dataset`, `Report`, `Coverage`, `Tuning`, `Run`, `SequenceFiles`,
        `Fleet`, `Campaign`, `StoredDataset` or `Package`; `Datasets` for any other folder with
        several datasets or a split by scenario; a `Site`, a `RigSpec`, a `NodesFile` or a
        `Datasheet`; a `Background`; a `Cloud` or a `Recording`. For a typed result use
        ``ut.Dataset.open(path)`` or the same method of another class.

    Raises:
        InputError: the path is missing, damaged, or of no known kind.

    Example:
        >>> ut.open("out/dataset")[3].points
    """
    if is_url(path):
        from urbantwin.interface.stored_dataset import StoredDataset

        return StoredDataset.open(str(path))
    place = Path(path)
    if not place.exists():
        from urbantwin.fidelity.readers import open_recording
        from urbantwin.fidelity.readers.recording import file_and_choice

        if file_and_choice(place)[1] is None:
            raise InputError("not found", file=place, expected=_EXPECTED)
        return open_recording(place)
    if place.is_file():
        folder = place.parent
        if place.suffix != ".json" or kind_of(folder) != place.stem:
            return _opened_file(place)
        place = folder
    kind = kind_of(place)
    return _opened_folder(place) if kind is None else opened_artefact(place, kind)


def _opened_folder(place: Path) -> Any:  # noqa: ANN401 - see `open`
    """Open a folder that is not an artefact: a folder of artefacts, a site or a recording."""
    from urbantwin.dataset.reading.datasets import datasets_inside
    from urbantwin.interface.dataset import Datasets

    if kind_of(place / "index") == "campaign":
        return opened_artefact(place / "index", "campaign")
    there = [
        one for one in ("twin", "motion", "dataset") if (place / one / f"{one}.json").is_file()
    ]
    inside = datasets_inside(place) if there in ([], ["dataset"]) else []
    if there and len(inside) < 2:
        from urbantwin.interface.whole_line import Run

        return Run(place)
    if (place / "site.yaml").is_file():
        return _opened_file(place / "site.yaml")
    if inside:
        return Datasets(inside)
    from urbantwin.fidelity.readers import open_recording

    return open_recording(place)


def opened_artefact(
    folder: Path, kind: str
) -> Twin | Motion | Dataset | Report | Coverage | Tuning | Package:
    """Open an artefact of a kind.

    Raises:
        InputError: the content does not match the kind.
    """
    if kind not in _CLASSES:
        return Package(folder, kind)
    module, name = _CLASSES[kind]
    found: Any = getattr(import_module(f"urbantwin.interface.{module}"), name)
    opened: Twin | Motion | Dataset | Report | Coverage | Tuning = found.open(folder)
    return opened


def _opened_file(path: Path) -> Any:  # noqa: ANN401 - see `open`
    ending = path.suffix.lower()
    if ending == ".npz":
        from urbantwin.interface.measured_background import Background

        return Background.open(path)
    if ending in (".yaml", ".yml"):
        return _opened_yaml(path)
    from urbantwin.fidelity.clouds import read_cloud
    from urbantwin.io.points import is_cloud

    if is_cloud(path):
        return read_cloud(path)
    if ending == ".json" and says_split(path):
        from urbantwin.interface.dataset import Datasets

        return Datasets.open(path)
    if ending in (".json", ".csv"):
        from urbantwin.interface.sensor_catalogue import Datasheet

        return Datasheet.open(path)
    from urbantwin.fidelity.readers import open_recording

    return open_recording(path)


def _opened_yaml(path: Path) -> Any:  # noqa: ANN401 - see `open`
    from urbantwin.site.yaml_document import read_document

    fields = read_document(path, kind="a site, a rig, nodes or a sensor").value
    if "anchor" in fields:
        from urbantwin.interface.site_file import Site

        return Site.open(path)
    if "channels" in fields:
        from urbantwin.interface.sensor_catalogue import Datasheet

        return Datasheet.open(path)
    if "nodes" in fields:
        from urbantwin.site.nodes import load_nodes

        return load_nodes(path)
    from urbantwin.site.rig import load_rig_spec

    return load_rig_spec(path)
