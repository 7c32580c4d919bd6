"""A twin's roads against the ground that a real survey measured in Pittsburgh."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from pyproj import Transformer

from urbantwin.geometry import DownwardProbe
from urbantwin.scene.surface import PARTS
from urbantwin.site import load_site
from urbantwin.twin import build_twin

from ..real_files import argoverse_map

STREETS = runpy.run_path(str(Path(__file__).parent / "argoverse_streets.py"))


@pytest.mark.thorough
@pytest.mark.parametrize("source", ["streets", "vector map"])
def test_roads_lie_within_5_cm_rms_of_the_measured_ground(shared_data, tmp_path, source):
    log = STREETS["Log"](shared_data)
    log.write_dem(tmp_path / "ground.tif")
    if source == "streets":
        log.write_osm(tmp_path / "streets.osm")
        roads_of = {"osm": "streets.osm"}
    else:
        roads_of = {"roads": str(argoverse_map(shared_data, "lanes"))}
    site = {
        "anchor": dict(zip(("latitude", "longitude"), STREETS["ANCHOR"], strict=True)),
        "region": {"radius_m": 80},
        **roads_of,
        "dem": "ground.tif",
        "closed_loop": False,
        "rig": {"sensors": [{"name": "a", "model": "OS1-128", "east_m": 0, "north_m": 0,
                             "height_m": 6}]},
    }  # fmt: skip
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site))
    twin = build_twin(load_site(tmp_path / "site.yaml"), tmp_path / "twin")

    to_site = Transformer.from_crs("EPSG:32617", twin.frame.proj, always_xy=True)
    places, measured = log.known_heights()
    xy = np.column_stack(to_site.transform(*places.T))
    lanes = shapely.transform(
        shapely.union_all([log.area(k) for k in log.segments]),
        lambda points: np.column_stack(to_site.transform(*points.T)),
    )
    roads = shapely.intersection_all(
        [lanes, shapely.buffer(twin.roads.carriageway(0), -0.2), twin.region]
    )
    shapely.prepare(roads)
    on_road = shapely.contains_xy(roads, *xy.T)
    assert on_road.sum() > 30_000
    above = np.column_stack([xy[on_road], np.full(on_road.sum(), 100.0)])
    ours = DownwardProbe(twin.ground_mesh).height_below(above)
    assert np.isfinite(ours).all()
    if source == "vector map":
        # Nothing is raised where the map says that vehicles can drive.
        islands = twin.ground_mesh.select(twin.ground_mesh.part == PARTS["island"])
        drivable = shapely.transform(
            log.drivable(), lambda points: np.column_stack(to_site.transform(*points.T))
        )
        middle = islands.triangles().mean(axis=1)
        inside = shapely.contains_xy(drivable, *middle[:, :2].T)
        assert islands.areas()[inside].sum() < 1.0
        paved = np.isin(twin.ground_mesh.part, [PARTS["carriageway"], PARTS["paved"]])
        paved_m2 = twin.ground_mesh.select(paved).areas().sum()
        assert paved_m2 > 0.98 * drivable.intersection(twin.region).area
    off = ours + twin.manifest["notes"]["ground"]["anchor_height_m"] - measured[on_road]
    assert np.sqrt(np.mean(off**2)) < 0.05
