"""From a site to its twin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
import yaml

from urbantwin import __version__
from urbantwin.artefact import replaced_folder, sha256_of, write_json
from urbantwin.errors import InputError
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.roads.imported import ImportedMap, build_imported_roads, prepared_map, read_map
from urbantwin.roads.signals import heads_of
from urbantwin.scene import build_scene
from urbantwin.scene.ground_material import surface_materials
from urbantwin.site import (
    Extract,
    OsmFeature,
    Site,
    check_extract,
    read_extract,
    read_heights,
)
from urbantwin.twin.twin import Twin, load_twin

__all__ = ["build_twin"]

Progress = Callable[[float, str], None]


def build_twin(site: Site, out: Path, progress: Progress | None = None) -> Twin:
    """Build a site's twin and write it to a folder, whole or not at all.

    Args:
        site: the checked site.
        out: the folder to write; an older twin there is replaced.
        progress: told the share done (0..1) and what is being done.

    Raises:
        InputError: the map, the DEM or the region cannot be used.
        StageError: netconvert failed.
    """
    tell = progress or (lambda share, text: None)
    tell(0.0, "reading the map")
    extract = read_extract(site.osm.path) if site.osm else None
    imported = read_map(site.roads.path, site.frame, site.anchor_m) if site.roads else None
    features = _features(site, extract)
    side = _driving_side(site, imported)
    with replaced_folder(out, kind="twin") as folder:
        tell(0.1, "ground")
        elevation, ground_notes = _elevation(site)
        net = folder / "network.net.xml"
        if imported:
            prepared = prepared_map(
                imported,
                site.region,
                elevation if site.dem else None,
                closed_loop=site.closed_loop,
            )
            elevation = prepared.elevation
            if site.dem is None and not elevation.is_flat:
                ground_notes = {"source": "no DEM: the heights of the map's roads, joined up"}
            tell(0.2, "roads")
            roads = build_imported_roads(prepared, site.frame, out=net, plans=site.signals)
        else:
            assert extract is not None
            tell(0.2, "roads")
            roads = build_roads(
                extract,
                site.frame,
                site.region,
                elevation,
                driving_side=side,
                out=net,
                plans=site.signals,
                closed_loop=site.closed_loop,
            )
        elevation.save(folder / "elevation.npz")
        roads.model.save(folder / "lane_model.json")
        roads.network.save(folder / "roads.json")
        tell(0.4, "scene")
        heads = heads_of(roads.model)
        scene = build_scene(roads.network, roads.surface, elevation, site.region, features, heads)
        scene.mesh.save(folder / "scene.npz")
        tell(0.85, "materials")
        surface = surface_materials(roads.model, roads.network, site.region, roads.surface.height)
        surface.save(folder / "surface_material.npz")
        tell(0.9, "writing")
        resolved = site.resolved()
        _write_yaml(folder / "site.yaml", {**resolved, "rig": "rig.yaml"})
        _write_yaml(folder / "rig.yaml", resolved["rig"])
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
                "driving_side": side,
                "region_m": np.round(shapely.get_coordinates(site.region), 4).tolist(),
                "inputs": site.inputs(),
                "notes": {"ground": ground_notes, "roads": roads.notes, **scene.notes},
                "files": {
                    path.name: sha256_of(path)
                    for path in sorted(folder.iterdir())
                    if path.name != "twin.json"
                },
            },
        )
    tell(1.0, "done")
    return load_twin(out)


def _features(site: Site, extract: Extract | None) -> list[OsmFeature]:
    """Return what is mapped in the region besides the roads.

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


def _driving_side(site: Site, imported: ImportedMap | None) -> str:
    """Return the side that people drive on: as the site says, the map of the roads, or the place.

    Raises:
        InputError: the site and the map of the roads say different things.
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


def _elevation(site: Site) -> tuple[Elevation, dict[str, object]]:
    if site.dem is None:
        return Elevation.flat(), {"source": "no DEM: a level plain"}
    grid = read_heights(site.dem.path, site.frame, site.region)
    notes: dict[str, object] = {
        "source": site.dem.path.name,
        "anchor_height_m": round(grid.anchor_height_m, 3),
        "missing_share": round(grid.missing_share, 4),
        "cell_m": round(grid.source_step_m, 3),
    }
    return Elevation(grid.x0, grid.y0, grid.step_m, grid.heights, grid.source_step_m), notes


def _write_yaml(path: Path, value: object) -> None:
    path.write_text(yaml.safe_dump(value, sort_keys=False, allow_unicode=True))
