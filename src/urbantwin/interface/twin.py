"""Twins: built from a site, or opened."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.interface.command import command
from urbantwin.interface.outcome import outcome_of_twin
from urbantwin.interface.place import AnyPath, folder_of_site
from urbantwin.interface.rig import fields_below
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.progress import Progress
from urbantwin.roads.network import Lane
from urbantwin.twin import Twin as BuiltTwin
from urbantwin.twin import load_twin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from urbantwin.geometry import LabelledMesh
    from urbantwin.processes import Helpers
    from urbantwin.reconstruct import Reconstruction
    from urbantwin.roads import RoadNetwork
    from urbantwin.scene.preview import ScenePreview
    from urbantwin.site import Site
    from urbantwin.twin.standing_rig import StandingRig

__all__ = ["Twin", "build", "build_of", "rig_field", "site_with_known_sensors"]


class Twin(Artefact, BuiltTwin):
    """A twin on disk; each part is read on first access.

    Besides the attributes of `urbantwin.twin.Twin` (``mesh``: vertices (V, 3) and faces (F, 3) with
    their semantic class and material; ``roads``; ``lane_model``; ``elevation``; ``site``;
    ``region``), it has ``plot``, and can be passed as its folder.

    Example:
        >>> twin = ut.open("out/twin")
        >>> twin.mesh.vertices.shape, twin.lanes[0].centre.shape
        >>> twin.plot().savefig("plan.png")
    """

    @classmethod
    def open(cls, folder: AnyPath) -> Twin:
        """Open a twin's folder; a twin is returned as it is.

        Raises:
            InputError: the folder is not a twin, or a file does not have its recorded checksum.
        """
        if isinstance(folder, Twin):
            return folder
        found = load_twin(Path(folder))
        return cls(found.folder, found.manifest)

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """The lanes as strips: centre lines (N, 3), widths, kinds, allowed classes."""
        return tuple(self.roads.lanes)

    def __repr__(self) -> str:
        """Return name, place, counts and folder."""
        return (
            f"Twin {self.manifest['name']!r} at {self.frame.latitude:.5f}, "
            f"{self.frame.longitude:.5f}: {self.region.area:,.0f} m2, "
            f"{len(self.mesh.faces):,} triangles, {len(self.roads.lanes)} lanes, "
            f"{len(self.roads.signals)} signals ({self.folder})"
        )

    def summary(self) -> Summary:
        """Return the twin's content in brief."""
        from urbantwin.roads.signals.programs import described_signals
        from urbantwin.taxonomy import semantic_classes

        names = {entry.id: entry.name for entry in semantic_classes().values()}
        triangles = Counter(names[int(number)] for number in self.mesh.semantic)
        return Summary(
            path=str(self.folder),
            kind="twin",
            name=self.manifest["name"],
            made_with=f"urbantwin {self.manifest['version']}",
            latitude=self.frame.latitude,
            longitude=self.frame.longitude,
            region_m2=round(self.region.area, 1),
            driving_side=self.manifest["driving_side"],
            **outcome_of_twin(self),
            triangles=len(self.mesh.faces),
            triangles_by_class=dict(triangles.most_common()),
            signals=described_signals(self.net_path),
            notes=self.manifest["notes"],
            inputs=[
                {key: item[key] for key in ("name", "licence", "attribution")}
                for item in self.manifest["inputs"]
            ],
            warnings=[str(one) for one in self.warnings],
        )

    def plot(self, picture: str = "plan") -> Figure:
        """Draw the twin.

        Args:
            picture: ``plan``, the lane network from above; ``sight``, the sensors' view of the
                junction; ``scene``, an elevated view of the scene; or ``ground``, the materials of
                the ground.

        Raises:
            InputError: the picture is unknown.
        """
        from urbantwin.drawing.pictures import figure_of_twin

        return figure_of_twin(self, picture)


@command
def build(
    site: AnyPath,
    out: AnyPath | None = None,
    *,
    pictures: bool = True,
    key_env: Sequence[str] | None = None,
    allow_key: Sequence[str] | None = None,
    progress: ShowProgress = True,
) -> Twin:
    """Build a site's twin: ground, roads, labelled scene.

    Args:
        site: the ``site.yaml``, or its folder.
        out: folder to write, in which an older twin is replaced; ``NAME/twin`` beside the site if
            not given.
        pictures: draw pictures into the twin's folder.
        key_env: environment variables that the site's file may use as keys, beside those whose
            names begin with ``URBANTWIN_``.
        allow_key: ``NAME=https://host``: variable, and the server that its key may be sent to.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the site, or a file that it names, cannot be used; ``out`` holds other files;
            the site needs a key that is not allowed.
        StageError: netconvert failed, or the disk is full.

    Example:
        >>> twin = ut.build("examples/two-avenues/site.yaml")
        $ urbantwin build mysite/site.yaml -o twin/
    """
    from urbantwin.download import keys_allowed

    with keys_allowed(key_env, allow_key):
        checked = site_with_known_sensors(Path(site))
        folder = folder_of_site(checked.file, checked.name) / "twin" if out is None else Path(out)
        return build_of(checked, folder, pictures=pictures, progress=progress)


def site_with_known_sensors(path: Path) -> Site:
    """Read a site and check its sensors against the catalogue."""
    from urbantwin.lidar.sensor_options import check_models
    from urbantwin.site import load_site

    site = load_site(path)
    with fields_below(rig_field(site), site.rig_file):
        check_models(site.rig, file=site.rig_file)
    return site


def build_of(
    site: Site,
    out: Path,
    *,
    pictures: bool,
    progress: ShowProgress,
    helpers: Helpers | None = None,
) -> Twin:
    """Build a twin with the site's own rig mounted, and draw pictures of it and of its geometry.

    Helper processes that are ready draw some of the pictures.
    """
    from urbantwin.lidar.placement import refuse_places
    from urbantwin.lidar.sight import standing_rig
    from urbantwin.twin import build_twin

    found: list[Reconstruction] = []

    def refuse(scene: ScenePreview, anchor_height_m: float | None) -> None:
        with fields_below(rig_field(site), site.rig_file):
            refuse_places(site.rig, scene, file=site.rig_file, anchor_height_m=anchor_height_m)

    def stand(
        site: Site,
        network: RoadNetwork,
        mesh: LabelledMesh,
        anchor_height_m: float | None,
        tell: Progress,
    ) -> StandingRig:
        with fields_below(rig_field(site), site.rig_file):
            return standing_rig(site, network, mesh, anchor_height_m, tell)

    def also(twin: BuiltTwin, tell: Progress) -> None:
        if pictures:
            from urbantwin.drawing.geometry_pictures import pictures_of_geometry
            from urbantwin.drawing.pictures import attributions, pictures_of_twin

            folder = twin.folder / "pictures"
            if found:
                sources = attributions({"inputs": site.inputs()})
                pictures_of_geometry(found[0], folder, attribution=sources)
            pool = None if helpers is None else helpers.ready
            pictures_of_twin(twin, folder, pool=pool, progress=tell)

    with shown_stage("twin", progress) as tell:
        built = build_twin(
            site, out, tell, watch=found.append, refuse=refuse, stand=stand, also=also
        )
    tell_result("twin", built.folder, built.warnings, progress)
    return Twin(built.folder, built.manifest)


def rig_field(site: Site) -> str:
    """Return the field of the site's rig in its file; empty if the rig has its own file."""
    return "rig" if site.rig_file == site.file else ""
