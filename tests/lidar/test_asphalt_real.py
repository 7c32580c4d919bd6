"""The law of rough ground against what two real VLP-32C returned of asphalt, by incidence."""

import json

import numpy as np
import pyarrow.feather
import pytest
import shapely
from scipy.spatial.transform import Rotation

from urbantwin.lidar.returns import scatter_of_materials
from urbantwin.taxonomy import material_id

from ..real_files import SWEEPS, argoverse_log, argoverse_map

pytestmark = pytest.mark.thorough


def lines_of(points):
    return np.array([[point["x"], point["y"]] for point in points])


@pytest.fixture(scope="module")
def asphalt(shared_data):
    """Cosine of incidence on the map's ground, and calibrated reflectivity in percent (N, 2).

    Points on lanes, away from painted lines, within 12 cm of the ground raster, in no real box.
    """
    folder = argoverse_log(shared_data)
    lanes = json.loads(argoverse_map(shared_data, "lanes").read_text())["lane_segments"]
    areas, painted = [], []
    for lane in lanes.values():
        left, right = (lines_of(lane[f"{side}_lane_boundary"]) for side in ("left", "right"))
        areas.append(shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]]))))
        painted += [
            shapely.LineString(line)
            for side, line in (("left", left), ("right", right))
            if lane[f"{side}_lane_mark_type"] != "NONE"
        ]
    road, paint = shapely.buffer(shapely.union_all(areas), -0.3), shapely.union_all(painted)
    raster = np.load(argoverse_map(shared_data, "heights"))
    to_cells = json.loads(argoverse_map(shared_data, "to_cells").read_text())
    slope_y, slope_x = np.gradient(raster.astype(float), 1 / to_cells["s"])
    table = pyarrow.feather.read_table
    poses = table(folder / "city_SE3_egovehicle.feather").to_pandas()
    mounts = table(folder / "calibration" / "egovehicle_SE3_sensor.feather").to_pandas()
    mounts = mounts.set_index("sensor_name")[["tx_m", "ty_m", "tz_m"]]
    boxes = table(folder / "annotations.feather").to_pandas()
    rows = []
    for path in [folder / name for name in SWEEPS]:
        sweep = table(path).to_pandas()
        pose = poses.iloc[(poses.timestamp_ns - int(path.stem)).abs().argmin()]
        turn = Rotation.from_quat([pose.qx, pose.qy, pose.qz, pose.qw])
        points = np.array(sweep[["x", "y", "z"]], float)
        there = turn.apply(points) + [pose.tx_m, pose.ty_m, pose.tz_m]
        cell = np.floor(to_cells["s"] * (there[:, :2] + to_cells["t"])).astype(int)
        on_map = ((cell >= 0) & (cell < raster.shape[::-1])).all(axis=1)
        cell = np.clip(cell, 0, np.array(raster.shape[::-1]) - 1)
        column, row = cell.T
        on_map &= np.abs(there[:, 2] - raster[row, column]) < 0.12
        normal = np.stack([-slope_x[row, column], -slope_y[row, column], np.ones(len(row))], 1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        for box in boxes[boxes.timestamp_ns == int(path.stem)].itertuples():
            inside = Rotation.from_quat([box.qx, box.qy, box.qz, box.qw]).inv()
            local = inside.apply(points - [box.tx_m, box.ty_m, box.tz_m])
            half = np.array([box.length_m, box.width_m, box.height_m]) / 2 + 0.3
            on_map &= ~(np.abs(local) < half).all(axis=1)
        lower = sweep.laser_number.to_numpy() >= 32
        origin = np.where(
            lower[:, None], mounts.loc["down_lidar"].to_numpy(), mounts.loc["up_lidar"].to_numpy()
        )
        range_m = np.linalg.norm(points - origin, axis=1)
        way = turn.apply(points - origin) / range_m[:, None]
        places = shapely.points(there[:, :2])
        on_map &= (range_m < 33) & shapely.contains_xy(road, *there[:, :2].T)
        on_map &= shapely.distance(places, paint) > 0.6
        rows.append(np.column_stack([-(way * normal).sum(axis=1), sweep.intensity])[on_map])
    found = np.concatenate(rows)
    return found[found[:, 0] > 0.03]


def test_asphalt_fades_at_a_slant_as_the_real_one_does(asphalt):
    """Mean reflectivity in twenty equal shares of the points; Lambert's is three times as far."""
    order = np.argsort(asphalt[:, 0])
    shares = np.array_split(asphalt[order], 20)
    cosine = np.array([np.median(share[:, 0]) for share in shares])
    percent = np.array([share[:, 1].mean() for share in shares])
    assert len(asphalt) > 10_000
    assert cosine[0] < 0.06
    assert cosine[-1] > 0.42
    number = np.full(20, material_id("asphalt"), np.uint8)
    ours = 100 * scatter_of_materials(903.0).backscatter(number, cosine)
    away = np.sqrt(np.mean((ours - percent) ** 2))
    best_lambert = (percent * cosine).sum() / (cosine**2).sum() * cosine
    assert away < 0.8
    assert away < 0.5 * np.sqrt(np.mean((best_lambert - percent) ** 2))
