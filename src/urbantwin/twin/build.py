"""From a site to its twin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
import yaml

from urbantwin import __version__
from urbantwin.artefact import replaced_folder, sha256_of, write_json
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.scene import build_scene
from urbantwin.site import Site, check_extract, read_extract, read_heights
from urbantwin.twin.twin import Twin, load_twin

__all__ = ["build_twin"]

#: Cell size of the ground's grid, metres.
GRID_STEP_M = 1.0

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
    extract = read_extract(site.osm.path)
    check_extract(site, extract)
    mapped = driving_side(site.latitude, site.longitude)
    side = mapped if site.driving_side == "auto" else site.driving_side
    with replaced_folder(out, kind="twin") as folder:
        tell(0.1, "ground")
        elevation, ground_notes = _elevation(site)
        elevation.save(folder / "elevation.npz")
        tell(0.2, "roads")
        roads = build_roads(
            extract,
            site.frame,
            site.region,
            elevation,
            driving_side=side,
            out=folder / "network.net.xml",
            plans=site.signals,
        )
        roads.model.save(folder / "lane_model.json")
        roads.network.save(folder / "roads.json")
        tell(0.4, "scene")
        features = extract.features(site.frame, site.region)
        scene = build_scene(roads.network, roads.lift, elevation, site.region, features)
        scene.mesh.save(folder / "scene.npz")
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


def _elevation(site: Site) -> tuple[Elevation, dict[str, object]]:
    if site.dem is None:
        return Elevation.flat(), {"source": "no DEM: a level plain"}
    grid = read_heights(site.dem.path, site.frame, site.region, GRID_STEP_M)
    notes: dict[str, object] = {
        "source": site.dem.path.name,
        "anchor_height_m": round(grid.anchor_height_m, 3),
        "missing_share": round(grid.missing_share, 4),
    }
    return Elevation(grid.x0, grid.y0, grid.step_m, grid.heights), notes


def _write_yaml(path: Path, value: object) -> None:
    path.write_text(yaml.safe_dump(value, sort_keys=False, allow_unicode=True))
