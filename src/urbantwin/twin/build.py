"""Building a twin from its site, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml

from urbantwin import __version__
from urbantwin.artefact import check_folder, replaced_folder, sha256_of, write_json
from urbantwin.download import key_for
from urbantwin.errors import InputError
from urbantwin.ground import Elevation
from urbantwin.progress import Progress, between, untold
from urbantwin.reconstruct import Reconstruction, outcome
from urbantwin.reconstruct.actor_mesh import read_actor_mesh
from urbantwin.result_warning import rows_of
from urbantwin.roads import BuiltRoads, build_roads, driving_side
from urbantwin.roads.driving_side import country_of
from urbantwin.roads.imported import ImportedMap, build_imported_roads, prepared_map, read_map
from urbantwin.roads.no_roads import no_roads
from urbantwin.roads.round_standing import standing_on_ground
from urbantwin.roads.signals import heads_of
from urbantwin.scene import build_scene
from urbantwin.scene.ground_material import ground_materials
from urbantwin.scene.preview import ScenePreview, preview_of_scene
from urbantwin.site import (
    Extract,
    Orthophoto,
    OsmFeature,
    Site,
    box_around,
    check_extract,
    read_extract,
    read_orthophoto,
)
from urbantwin.site.building_file import read_buildings, with_buildings
from urbantwin.site.conditional_tags import at_time
from urbantwin.site.geometry import GeometrySource
from urbantwin.site.imagery import ImagerySource
from urbantwin.site.sketch import read_sketch
from urbantwin.twin.corrections import Corrections
from urbantwin.twin.found_of_mapped import found_of_mapped, share_known
from urbantwin.twin.ground import SurveyedSite, survey_ground
from urbantwin.twin.own_meshes import write_own_meshes
from urbantwin.twin.provenance import made_from
from urbantwin.twin.result_warnings import warnings_of_build
from urbantwin.twin.sensor_files import copy_sensor_files
from urbantwin.twin.standing_rig import Stand, StandingRig
from urbantwin.twin.street_reflectivity import street_reflectivity
from urbantwin.twin.twin import Twin, anchor_height_m, load_twin

__all__ = ["build_twin"]

#: Margin around the region in which imagery of the ground is read, metres.
PICTURE_MARGIN_M = 25.0

#: Size from which maps take long to read, bytes; share of the time for reading such maps, and
#: others.
LARGE_MAP, LARGE_READ, SMALL_READ = 32 << 20, 0.4, 0.02
#: Progress after each part, measured for a district.
ROADS, ROADS_WRITTEN, SCENE, SCENE_WRITTEN, STANDING = 0.14, 0.2, 0.78, 0.84, 0.87
#: Progress after which the twin is complete and its pictures are drawn.
BUILT = 0.8


def build_twin(  # noqa: PLR0915 - one step per stage
    site: Site,
    out: Path,
    progress: Progress | None = None,
    *,
    watch: Callable[[Reconstruction], None] | None = None,
    refuse: Callable[[ScenePreview, float | None], None] | None = None,
    stand: Stand | None = None,
    also: Callable[[Twin, Progress], None] | None = None,
) -> Twin:
    """Build a site's twin and write it to a folder, atomically.

    Args:
        site: the checked site.
        out: the folder to write; an earlier twin there is replaced.
        progress: called with the fraction done (0..1) and the current task.
        watch: called with the imported geometry, for pictures of its placement and cleaning.
        refuse: called before the scene is built, with the known surroundings of the sensors and the
            height of the anchor's ground in the DEM's datum, for early errors.
        stand: places the site's rig in the scene.
        also: called with the complete twin before the folder appears, for checks and further files
            such as pictures.

    Raises:
        InputError: the map, the DEM or the region cannot be used.
        StageError: netconvert failed.
    """
    check_folder(out, kind="twin", inputs=site.files())
    _check_keys(site)
    whole = progress or untold
    extract, tell = _read(site, between(whole, 0.0, 1.0 if also is None else BUILT))
    extract, completed = _with_buildings_file(site, extract)
    imported = read_map(site.roads.path, site.frame, site.anchor_m) if site.roads else None
    side = _driving_side(site, imported)
    corrections = Corrections.of_site(site)
    extract = corrections.map_corrected(extract, site, side)
    if extract is not None:
        extract, open_at_times = at_time(extract, site.traffic.time_of_day)
    else:
        open_at_times = []
    features = _features(site, extract)
    photo = _ground_imagery(site)
    # Imported geometry takes as long as everything else.
    surveying = 0.4 if site.geometry else 0.02
    with replaced_folder(out, kind="twin", inputs=site.files()) as folder:
        tell(0.0, "ground")
        ground = survey_ground(
            site,
            features,
            imported.model if imported else None,
            between(tell, 0.0, surveying),
        )
        elevation, ground_notes, reconstruction = (
            ground.elevation,
            ground.notes,
            ground.reconstruction,
        )
        net = folder / "network.net.xml"
        if imported:
            prepared = prepared_map(
                imported,
                site.region,
                elevation if ground.is_known else None,
                closed_loop=site.closed_loop,
            )
            elevation = prepared.elevation
            if not ground.is_known and not elevation.is_flat:
                ground_notes = {"source": "no DEM: the heights of the map's roads, joined up"}
            tell = between(tell, surveying, 1.0)
            tell(0.0, "roads")
            roads = build_imported_roads(prepared, site.frame, out=net, plans=site.signals)
        elif extract is None:
            tell = between(tell, surveying, 1.0)
            roads = no_roads(elevation, side, net)
        else:
            tell = between(tell, surveying, 1.0)
            roads = build_roads(
                extract,
                site.frame,
                site.region,
                elevation,
                driving_side=side,
                out=net,
                plans=site.signals,
                closed_loop=site.closed_loop,
                per_hour=site.traffic.per_hour,
                curbs=corrections.curbs(),
                standing=standing_on_ground(reconstruction.mesh, elevation)
                if reconstruction
                else (),
                tell=between(tell, 0.0, ROADS, "roads"),
            )
        corrections.keep_curbs(roads.curbs, site)
        tell(ROADS, "writing the roads")
        elevation.save(folder / "elevation.npz")
        roads.model.save(folder / "lane_model.json")
        roads.network.save(folder / "roads.json")
        _before_scene(refuse, site, roads, elevation, features, ground)
        tell(ROADS_WRITTEN, "scene")
        heads = heads_of(roads.model)
        scene = build_scene(
            roads.network,
            roads.surface,
            elevation,
            site.region,
            features,
            heads,
            reconstruction,
            imported.drivable if imported else None,
            country=country_of(site.latitude, site.longitude),
            clutter=site.clutter,
            sensors=[(east, north) for _, east, north in site.rig.standing()],
            corrections=corrections.of_scene,
            own_objects=site.street_objects.path if site.street_objects else None,
            tell=between(tell, ROADS_WRITTEN, SCENE, "scene"),
        )
        tell(SCENE, "writing the scene")
        scene.save(folder)
        corrections.keep(scene.corrected)
        tell(SCENE_WRITTEN, "materials")
        material = ground_materials(
            roads.model,
            roads.network,
            site.region,
            roads.surface.height,
            mesh=scene.mesh,
            photo=photo,
        )
        material.surface.save(folder / "surface_material.npz")
        tell(STANDING, "standing the sensors")
        # The scene avoids the proposed positions of sensors, so the unplaced site is needed to
        # reproduce it.
        requested, stood = site, StandingRig(site.rig)
        if stand is not None:
            stood = stand(
                site,
                roads.network,
                scene.mesh,
                anchor_height_m(ground_notes),
                between(tell, STANDING, 1.0),
            )
            site = replace(site, rig=stood.spec)
        own = {
            spec.name: read_actor_mesh(
                path, spec.actor_class, scale=spec.scale, forward=spec.forward
            )
            for spec, path in site.own_assets
        }
        write_own_meshes(folder, own)
        of_sources = _written_geometry(folder, reconstruction, watch)
        mapped = found_of_mapped(
            None if imported else extract, site.frame, site.region, roads.network
        )
        notes = {
            "ground": ground_notes,
            "roads": roads.notes,
            "mapped": {kind: counts.as_note() for kind, counts in mapped.items()},
            **({"geometry": of_sources} if reconstruction else {}),
            **({"buildings_file": completed} if completed else {}),
            **scene.notes,
            "materials": {
                **material.notes,
                "reflectivity": street_reflectivity(site.latitude, site.longitude),
            },
            **({"sensors": stood.notes} if stood.notes else {}),
            **corrections.notes(),
        }
        _write_documents(
            folder,
            site,
            {
                "driving_side": side,
                "made_from": made_from(
                    requested,
                    reconstruction.report if reconstruction else None,
                    photo.notes if photo else (),
                ),
                "notes": notes,
                "warnings": rows_of(
                    [
                        *warnings_of_build(
                            roads,
                            mapped,
                            of_sources,
                            scene=scene.notes,
                            known=share_known(extract, site.frame, site.region),
                            open_at_times=open_at_times,
                        ),
                        *corrections.warnings(),
                        *stood.warnings,
                    ]
                ),
            },
        )
        if also is not None:
            also(load_twin(folder), between(whole, BUILT, 1.0))
    whole(1.0, "done")
    return load_twin(out)


def _write_documents(folder: Path, site: Site, told: Mapping[str, object]) -> None:
    """Write the resolved site and rig, and ``twin.json``."""
    _write_yaml(folder / "site.yaml", {**site.resolved(), "rig": "rig.yaml"})
    _write_yaml(folder / "rig.yaml", copy_sensor_files(site.rig, site.rig_file, folder))
    write_json(
        folder / "twin.json",
        {
            "kind": "twin",
            "version": __version__,
            "name": site.name,
            "anchor": {
                "latitude": site.latitude,
                "longitude": site.longitude,
                "proj": site.frame.proj,
            },
            "region_m": np.round(shapely.get_coordinates(site.region), 4).tolist(),
            "inputs": site.inputs(),
            **told,
            "files": {path.name: sha256_of(path) for path in sorted(folder.iterdir())},
        },
    )


def _read(site: Site, tell: Progress) -> tuple[Extract | None, Progress]:
    """Read the map around the region; return it with the progress of the later stages."""
    tell(0.0, "reading the map")
    if site.sketch is not None:
        return read_sketch(site.sketch.path, site.frame), tell
    if site.osm is None:
        return None, tell
    read = LARGE_READ if site.osm.path.stat().st_size > LARGE_MAP else SMALL_READ
    bounds = box_around(site.frame, site.region)
    extract = read_extract(site.osm.path, bounds, progress=between(tell, 0.0, read))
    return extract, between(tell, read, 1.0)


def _with_buildings_file(
    site: Site, extract: Extract | None
) -> tuple[Extract | None, dict[str, str | int]]:
    """Return the map completed by the site's file of buildings, and notes about it."""
    if extract is None or site.buildings is None:
        return extract, {}
    footprints = read_buildings(site.buildings.path)
    more, counts = with_buildings(extract, footprints, site.frame, site.region)
    return more, {"source": site.buildings.path.name, **counts}


def _features(site: Site, extract: Extract | None) -> list[OsmFeature]:
    """Return the mapped features of the region, without roads.

    Raises:
        InputError: the extract has nothing there.
    """
    if extract is None:
        return []
    if site.roads is None:
        check_extract(site, extract)
    features = extract.features(site.frame, site.region)
    if not features:
        raise InputError(
            f"has nothing within the region of {site.file.name}",
            file=extract.path,
            expected=f"an extract around {site.latitude:.6f}, {site.longitude:.6f}",
        )
    return features


def _written_geometry(
    folder: Path,
    found: Reconstruction | None,
    watch: Callable[[Reconstruction], None] | None,
) -> dict[str, Any]:
    """Write the report on the sources of geometry; return notes on each source."""
    if found is None:
        return {}
    write_json(folder / "geometry.json", found.report)
    if watch is not None:
        watch(found)
    return outcome(found.report)


def _before_scene(
    refuse: Callable[[ScenePreview, float | None], None] | None,
    site: Site,
    roads: BuiltRoads,
    elevation: Elevation,
    features: list[OsmFeature],
    ground: SurveyedSite,
) -> None:
    """Call ``refuse`` with the known surroundings of the sensors."""
    if refuse is None:
        return
    reconstruction = ground.reconstruction
    preview = preview_of_scene(
        [(east, north) for _, east, north in site.rig.standing()],
        roads.network,
        roads.surface,
        elevation,
        site.region,
        features,
        reconstruction.covers.get("buildings") if reconstruction else None,
        country_of(site.latitude, site.longitude),
    )
    refuse(preview, anchor_height_m(ground.notes))


def _check_keys(site: Site) -> None:
    """Check that the user allows every key to be sent to its address.

    Raises:
        InputError: one is not allowed (`download.key_for`).
    """
    addresses: list[tuple[GeometrySource | ImagerySource, str | None]] = []
    addresses += [(source, source.spec.url) for source in site.geometry]
    addresses += [(source, source.spec.xyz) for source in site.imagery if source.is_web]
    for source, address in addresses:
        name = source.spec.key_env
        if name is not None and address is not None:
            key_for(name, address, file=source.document.file, place=source.place("key_env"))


def _ground_imagery(site: Site) -> Orthophoto | None:
    """Read the imagery of the ground, with a margin around the region."""
    if not site.imagery:
        return None
    return read_orthophoto(site.imagery, site.frame, site.region.buffer(PICTURE_MARGIN_M))


def _driving_side(site: Site, imported: ImportedMap | None) -> str:
    """Return the driving side: of the site, the map of the roads, or the country.

    Raises:
        InputError: the site contradicts the map of the roads.
    """
    if imported is None:
        mapped = driving_side(site.latitude, site.longitude)
        return mapped if site.driving_side == "auto" else site.driving_side
    mapped = imported.model.driving_side
    if site.driving_side not in ("auto", mapped):
        raise InputError(
            f"is {site.driving_side}, and in {imported.path.name} people drive on the {mapped}",
            file=site.file,
            place="roads.driving_side",
            expected="auto",
        )
    return mapped


def _write_yaml(path: Path, value: object) -> None:
    path.write_text(yaml.safe_dump(value, sort_keys=False, allow_unicode=True), encoding="utf-8")
