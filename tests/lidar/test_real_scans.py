"""The simulated sensors against scans of real ones, measured by `real_cases`.

What is asserted is agreement with real data: nothing here was fitted to it but the roughness and
the reflectivity of asphalt, which are Argoverse's (`notebook/real_lidar.md`).
"""

import numpy as np
import pytest

from ..real_cases import ouster_street, roadside_scan
from ..real_files import ouster_scans
from ..real_files import roadside as of_roadside


@pytest.fixture(scope="module")
def ouster(shared_data):
    """Return what the benchmark measures of the real OS1-128's scans."""
    return ouster_street.measure(ouster_scans(shared_data))


@pytest.fixture(scope="module")
def roadside(shared_data):
    """Return what the benchmark measures of the real roadside VLS-128."""
    return roadside_scan.measure(of_roadside(shared_data))


def _range_of_half(rows, side):
    """Where a share that grows with range first reaches one half, metres."""
    middle = [np.sqrt(row["range_m"][0] * row["range_m"][1]) for row in rows]
    share = np.maximum.accumulate([row[side] for row in rows])
    return float(np.interp(0.45, share, middle))


def test_the_scans_are_the_documented_ones(ouster):
    assert ouster["returns"][0] == 107_647
    assert ouster["beam_error_deg"] < 0.01


def test_the_road_is_lost_where_the_real_sensor_loses_it(ouster):
    real, simulated = (_range_of_half(ouster["road_missing"], s) for s in ("real", "simulated"))
    assert simulated == pytest.approx(real, rel=0.25)


def test_the_loss_of_the_road_sets_in_as_early(ouster):
    """Within a factor of four wherever the real sensor loses 5 to 40 % of it."""
    rows = [row for row in ouster["road_missing"] if row["range_m"][1] <= 30]
    rows = [row for row in rows if row["real"] > 0.05]
    assert len(rows) == 3
    for row in rows:
        assert 0.25 < row["simulated"] / row["real"] < 1.5


def test_surfaces_that_are_not_ground_return_as_often(ouster):
    rows = [row for row in ouster["dropout_by_range"] if row["surface"] == "other"]
    assert sum(row["pixels"] for row in rows) > 100_000
    weights = [row["pixels"] for row in rows]
    apart = [abs(row["real"] - row["simulated"]) for row in rows]
    assert np.average(apart, weights=weights) < 0.03


def test_planes_are_as_noisy(ouster):
    """Best quartiles; facades' stones and frames add to the real ones alone."""
    ratio = np.array([r["simulated_mm"][0] / r["real_mm"][0] for r in ouster["range_noise"]])
    assert len(ratio) > 10
    assert ((ratio > 0.3) & (ratio < 2.5)).all()
    assert 0.5 < np.median(ratio) < 2.0


def test_asphalt_is_as_bright_as_the_real_sensor_says(ouster):
    rows = ouster["asphalt"]
    assert len(rows) > 5
    for row in rows:
        if row["range_m"] < 25:  # beyond, the real road's survivors are its bright places
            assert row["simulated"] == pytest.approx(row["real"], abs=0.02)


def test_real_roadside_points_stand_on_the_catalogues_beams(roadside):
    assert roadside["table_error_deg"] < 1e-4
    for frame in roadside["frames"]:
        assert frame["elevation_error_deg"] < 1e-3
        assert frame["off_range_step"] < 0.01


def test_real_roadside_points_gather_in_columns_by_the_catalogues_offsets(roadside):
    """An encoder's steps are hundredths of a degree: the offsets are right to far below that."""
    for frame in roadside["frames"]:
        assert frame["columns"]["widest_deg"] < 1e-3
        assert frame["columns"]["columns"] > 900
        assert frame["columns_without_offsets"]["widest_deg"] > 1
        assert frame["columns_with_signs_turned"]["widest_deg"] > 1
