"""Asphalt and lane paint against what two real VLP-32C returned of them."""

import json

import numpy as np
import pyarrow.feather
import pytest
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id, semantic_id

from ..real_files import SWEEPS, argoverse_log, argoverse_map
from ..thin_rays import cast_static


def coordinates(points, keys="xy"):
    return np.array([[point[key] for key in keys] for point in points])


@pytest.fixture(scope="module")
def real(shared_data):
    """Range and calibrated reflectivity (percent) of road points: away from lines, and on them."""
    folder = argoverse_log(shared_data)
    lanes = json.loads(argoverse_map(shared_data, "lanes").read_text())["lane_segments"]
    areas, painted, white = [], [], []
    for lane in lanes.values():
        left, right = (coordinates(lane[f"{side}_lane_boundary"]) for side in ("left", "right"))
        areas.append(shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]]))))
        for side, line in (("left", left), ("right", right)):
            mark = lane[f"{side}_lane_mark_type"]
            if mark != "NONE":
                painted.append(shapely.LineString(line))
            if mark == "SOLID_WHITE":
                white.append(shapely.LineString(line))
    road = shapely.buffer(shapely.union_all(areas), -0.3)
    poses = pyarrow.feather.read_table(folder / "city_SE3_egovehicle.feather").to_pandas()
    mounts = pyarrow.feather.read_table(folder / "calibration" / "egovehicle_SE3_sensor.feather")
    mount = mounts.to_pandas().set_index("sensor_name").loc["up_lidar"]
    origin = mount[["tx_m", "ty_m", "tz_m"]].to_numpy(np.float64)
    rows = []
    for path in [folder / name for name in SWEEPS]:
        table = pyarrow.feather.read_table(path).to_pandas()
        pose = poses.iloc[(poses.timestamp_ns - int(path.stem)).abs().argmin()]
        w, x, y, z = pose.qw, pose.qx, pose.qy, pose.qz
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            ]
        )
        points = table[["x", "y", "z"]].to_numpy(np.float64)
        there = points @ turn.T + [pose.tx_m, pose.ty_m]
        ground = np.abs(points[:, 2]) < 0.25
        range_m = np.linalg.norm(points - origin, axis=1)
        places = shapely.points(there)
        rows.append(
            np.column_stack(
                [
                    range_m,
                    table.intensity,
                    ground,
                    ground & shapely.contains_xy(road, *there.T),
                    shapely.distance(places, shapely.union_all(painted)),
                    shapely.distance(places, shapely.union_all(white)),
                ]
            )
        )
    return np.concatenate(rows)


def simulated(name, range_m, height_m=1.97):
    """Backscatter in percent of a level road, seen from the car's upper sensor."""
    corners = np.array([[-200, -200, 0], [200, -200, 0], [200, 200, 0], [-200, 200, 0]])
    road = LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id(name)
    )
    down = height_m / range_m
    direction = np.array([[np.sqrt(1 - down**2), 0.0, -down]])
    hits = cast_static(road, np.array([0.0, 0.0, height_m]), direction, wavelength_nm=903.0)
    return 100.0 * hits.backscatter[0]


@pytest.mark.parametrize(("low", "high"), [(8.0, 12.0), (10.0, 15.0)])
def test_asphalt_and_white_lines_return_what_real_ones_do(real, low, high):
    """Within a factor of 2: rough asphalt fades less at a slant than a Lambertian surface does.

    Few beams hit nothing but paint: the upper tenth does.
    """
    range_m, percent, ground, on_road, from_paint, from_white = real.T
    near = (range_m > low) & (range_m < high)
    asphalt = percent[near & (on_road > 0) & (from_paint > 0.6)]
    white = percent[near & (ground > 0) & (from_white < 0.1)]
    assert len(asphalt) > 300
    assert len(white) > 10
    middle = (low + high) / 2
    assert 0.5 < simulated("asphalt", middle) / np.median(asphalt) < 2.0
    assert 0.5 < simulated("road-paint", middle) / np.percentile(white, 90) < 2.0
