"""The twin folder: its parts, and opening it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import shapely

from urbantwin.artefact import read_json, sha256_of
from urbantwin.artefact.manifest import validated
from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, PartColours, SiteFrame, SurfaceMaterials
from urbantwin.ground import Elevation
from urbantwin.result_warning import ResultWarning, warnings_of
from urbantwin.roads import LaneModel, RoadNetwork
from urbantwin.roads.sumo_check import check_sumo_network
from urbantwin.site import RigSpec, load_rig_spec
from urbantwin.site.yaml_document import read_document
from urbantwin.twin.manifest import Corrected, KeptSite, TwinManifest, check_region, file_inside
from urbantwin.twin.own_meshes import OWN_MESHES, read_own_meshes

__all__ = ["Twin", "load_twin"]


@dataclass(frozen=True)
class Twin:
    """A twin on disk; its parts are read on first use.

    Attributes:
        folder: its folder.
        manifest: the content of ``twin.json``.
    """

    folder: Path
    manifest: dict[str, Any]

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """The warnings of its manifest."""
        return warnings_of(self.manifest)

    @cached_property
    def frame(self) -> SiteFrame:
        """The site frame."""
        anchor = self.manifest["anchor"]
        return SiteFrame(anchor["latitude"], anchor["longitude"])

    @cached_property
    def region(self) -> shapely.Polygon:
        """The region of interest, site frame, metres."""
        return shapely.Polygon(self.manifest["region_m"])

    @cached_property
    def mesh(self) -> LabelledMesh:
        """Everything static, site frame."""
        return LabelledMesh.load(self._file("scene.npz"))

    @cached_property
    def ground_mesh(self) -> LabelledMesh:
        """The triangles of the ground: streets, sidewalks, terrain, decks."""
        level = self.mesh.normals()[:, 2] > 0.1
        return self.mesh.select(self.mesh.is_ground & level)

    @cached_property
    def surface_materials(self) -> SurfaceMaterials:
        """Materials of the ground finer than the mesh: lane markings, details from imagery."""
        name = "surface_material.npz"
        if name not in self.manifest.get("files", {}):
            return SurfaceMaterials()
        return SurfaceMaterials.load(self._file(name))

    @property
    def reflectivity(self) -> dict[str, float]:
        """Factors on the table's reflectivity of its streets' materials, by name."""
        return dict(self.manifest["notes"].get("materials", {}).get("reflectivity", {}))

    @cached_property
    def colours(self) -> PartColours:
        """Colours of buildings, for pictures."""
        name = "colours.npz"
        if name not in self.manifest.get("files", {}):
            return PartColours()
        return PartColours.load(self._file(name))

    @cached_property
    def own_meshes(self) -> dict[str, LabelledMesh]:
        """Meshes of the site's own actors, by name."""
        if OWN_MESHES not in self.manifest.get("files", {}):
            return {}
        return read_own_meshes(self._file(OWN_MESHES))

    @cached_property
    def lane_model(self) -> LaneModel:
        """The lane model, from which strips, mesh and OpenDRIVE are made."""
        return LaneModel.load(self._file("lane_model.json"))

    @cached_property
    def roads(self) -> RoadNetwork:
        """The lane network."""
        return RoadNetwork.load(self._file("roads.json"))

    @cached_property
    def elevation(self) -> Elevation:
        """The ground's heights."""
        return Elevation.load(self._file("elevation.npz"))

    @cached_property
    def site(self) -> dict[str, Any]:
        """The resolved site, as in ``site.yaml``."""
        document = read_document(self._file("site.yaml"), kind="a twin's site")
        document.validated(KeptSite)
        return dict(document.value)

    @cached_property
    def net_path(self) -> Path:
        """Path of the SUMO network, after validation."""
        path = self._file("network.net.xml")
        check_sumo_network(path)
        return path

    @property
    def corrections(self) -> list[Corrected]:
        """The outcome of each correction of the site."""
        entries = self.manifest["notes"].get("corrections", {}).get("each", [])
        return [Corrected.model_validate(entry) for entry in entries]

    @property
    def rig_path(self) -> Path:
        """The site's sensor rig."""
        return self._file("rig.yaml")

    @property
    def anchor_height_m(self) -> float | None:
        """Height of the anchor's ground in the DEM's datum, metres; ``None`` without a DEM."""
        return anchor_height_m(self.manifest.get("notes", {}).get("ground", {}))

    def rig_spec(self) -> RigSpec:
        """Read the site's sensor rig."""
        return load_rig_spec(self.rig_path, self.frame)

    @cached_property
    def sha256(self) -> str:
        """The hash of ``twin.json``, which holds the hashes of every other file."""
        return sha256_of(self.folder / "twin.json")

    def _file(self, name: str) -> Path:
        path = self.folder / name
        if not path.is_file():
            raise InputError("not found", file=path, expected="a complete twin")
        return path


def anchor_height_m(notes: object) -> float | None:
    """Return the height of the anchor's ground from a build's notes on the ground, metres."""
    value = notes.get("anchor_height_m") if isinstance(notes, dict) else None
    return float(value) if isinstance(value, int | float) else None


def load_twin(folder: Path) -> Twin:
    """Open a twin folder.

    Raises:
        InputError: it is not a twin, or a file in it was changed.
    """
    if not folder.is_dir():
        raise InputError("is not a folder", file=folder, expected="a twin, made by urbantwin build")
    file = folder / "twin.json"
    manifest = read_json(file, kind="twin")
    if manifest.get("kind") != "twin":
        raise InputError("is not a twin's", file=file, expected='"kind": "twin"')
    checked = validated(manifest, TwinManifest, file=file, expected="a twin's manifest")
    check_region(checked, file)
    for name, digest in checked.files.items():
        path = file_inside(folder, name, manifest=file)
        if not path.is_file() or sha256_of(path) != digest:
            raise InputError(
                "is missing" if not path.is_file() else "was changed since the twin was built",
                file=path,
                expected="the file that twin.json names; build the twin again",
            )
    return Twin(folder, manifest)
