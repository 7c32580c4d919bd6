"""From a folder of frames to a measured background that a scanner sees."""

import json

import numpy as np
from scipy.io import savemat

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner, beam_directions, place_rig, sensor
from urbantwin.lidar.background_file import load_backgrounds
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id


def flat_world():
    corners = [[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0]]
    return LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
    )


def test_frames_of_a_fixed_sensor_become_its_background(tmp_path, run_here):
    one = {"name": "a", "model": "VLP-16", "east_m": 0, "north_m": 0, "height_m": 3}
    spec = RigSpec.model_validate({"frame": "sensor", "sensors": [one]})
    scanner = Scanner(flat_world(), place_rig(spec, flat_world()), 0)
    real = tmp_path / "real"
    real.mkdir()
    for number in range(11):
        np.save(real / f"{number:03d}.npy", scanner.scan(number, []).points)
    outcome = run_here(
        "rig", "background", real, "--sensor", "VLP-16", "-o", tmp_path / "measured.npz", "--json"
    )
    assert outcome.code == 0
    told = json.loads(outcome.out)
    (measured,) = load_backgrounds(tmp_path / "measured.npz")
    assert told["frames"] == told["of"] == 11
    (one,) = told["sensors"]
    assert one["beams"] == measured.known.size == 16 * 1800
    assert one["with_background"] == measured.known.sum() > 3000
    assert (measured.model, measured.turns_per_second) == ("VLP-16", 10.0)
    # The lowest beam, 15 degrees down, from 3 m above a plane.
    lowest = measured.range_m[0][
        np.argmin(place_rig(spec, flat_world()).sensors[0].sensor.elevation_deg)
    ]
    np.testing.assert_allclose(np.median(lowest), 3 / np.sin(np.radians(15)), atol=0.03)


def test_what_is_no_such_sensor_or_recording_is_one_line(tmp_path, run_here):
    real = tmp_path / "real"
    real.mkdir()
    np.save(real / "0.npy", np.ones((5, 4), np.float32))
    out = tmp_path / "measured.npz"
    for arguments, word in (
        (("rig", "background", real, "--sensor", "VLP-17", "-o", out), "VLP-1"),
        (("rig", "background", real, "--sensor", "VLP-16", "--columns", "7", "-o", out), "columns"),
        (("rig", "background", tmp_path / "none", "--sensor", "VLP-16", "-o", out), "not found"),
        (
            ("rig", "background", real, "--sensor", "OS1-128", "--intensity-scale", "0", "-o", out),
            "scale",
        ),
    ):
        outcome = run_here(*arguments)
        assert outcome.code == 2
        assert word in outcome.err
        assert len(outcome.err.strip().splitlines()) == 1
        assert not out.exists()


def test_a_matrix_of_ranges_becomes_a_background(tmp_path, run_here):
    """Rows from the lowest beam, half a degree a cell: a range for each row and quadrant."""
    up = np.arange(-15.0, 16.0, 2.0)
    quadrant = np.repeat(np.arange(4), 180)
    ranges = 10.0 + np.arange(16)[:, None] + 20.0 * quadrant[None, :]
    ranges[:, quadrant == 3] = 0.0
    savemat(tmp_path / "ranges.mat", {"matrix": ranges})
    savemat(tmp_path / "up.mat", {"beams": np.radians(up)[None]})
    np.savetxt(tmp_path / "up.txt", up)
    np.save(tmp_path / "few.npy", ranges[:15])
    out = tmp_path / "measured.npz"
    given = ("--sensor", "VLP-16", "-o", out)
    for rows in ("up.mat", "up.txt"):
        outcome = run_here(
            "rig", "background", tmp_path / "ranges.mat", "--elevations", tmp_path / rows, *given
        )
        assert outcome.code == 0, outcome.err
        (found,) = load_backgrounds(out)
        aim = beam_directions(sensor("VLP-16"), 1800, turns_per_second=10.0)
        row = np.rint((np.degrees(np.arcsin(aim[..., 2])) + 15) / 2)
        azimuth = np.degrees(np.arctan2(aim[..., 1], aim[..., 0])) % 360
        expected = np.where(azimuth < 270, 10 + row + 20 * np.floor(azimuth / 90), 0)
        np.testing.assert_array_equal(found.range_m[0], expected)
    for arguments, word in (
        ((tmp_path / "few.npy", "--elevations", tmp_path / "up.txt", *given), "15 rows"),
        ((tmp_path / "ranges.mat", "--elevations", tmp_path / "none.txt", *given), "not found"),
        ((tmp_path / "ranges.mat", "--sensor", "OS1-32", "-o", out), "16 rows for 32"),
    ):
        outcome = run_here("rig", "background", *arguments)
        assert outcome.code == 2
        assert word in outcome.err
        assert len(outcome.err.strip().splitlines()) == 1
