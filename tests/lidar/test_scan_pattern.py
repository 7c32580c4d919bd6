"""Patterns that do not repeat with the frame, against the closed form of a rosette."""

import io
import zipfile

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.lidar import load_scan_pattern, pattern_directions

PERIOD_S = 4.0
TURNS = (41, 24)  # in a period, of two prisms that turn against each other


def rosette(time_s, turn=0.0):
    """Return azimuth and elevation, degrees: the sum of two turning wedges' deflections."""
    phase = 2 * np.pi * np.asarray(time_s) / PERIOD_S
    first, second = TURNS[0] * phase + turn, -TURNS[1] * phase + turn
    azimuth = 9.6 * (np.cos(first) + np.cos(second))
    return azimuth, 9.6 * (np.sin(first) + np.sin(second))


def towards(azimuth, elevation):
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


@pytest.fixture
def write(tmp_path):
    def make(count=8000, lines=1, ending="csv"):
        time_s = np.arange(count) * PERIOD_S / count
        path = tmp_path / f"rosette.{ending}"
        columns = {"time_s": [], "azimuth_deg": [], "elevation_deg": [], "line": []}
        for line in range(lines):
            azimuth, elevation = rosette(time_s, turn=0.1 * line)
            for name, values in zip(
                columns, (time_s, azimuth, elevation, np.full(count, line)), strict=True
            ):
                columns[name].append(values)
        table = {name: np.concatenate(values) for name, values in columns.items()}
        if ending == "npz":
            np.savez(path, **table)
        else:
            rows = np.column_stack(list(table.values()))
            np.savetxt(path, rows, "%.9f", ",", header=",".join(table), comments="")
        return path

    return make


@pytest.mark.parametrize("ending", ["csv", "npz"])
@pytest.mark.parametrize("lines", [1, 3])
def test_frames_follow_the_closed_form(write, ending, lines):
    pattern = load_scan_pattern(write(lines=lines, ending=ending))
    assert pattern.lines == lines
    assert pattern.period_s == pytest.approx(PERIOD_S)
    assert pattern.points_per_second == pytest.approx(2000 * lines)
    for frame in (0, 7, 39, 40, 1003):  # the pattern begins again at frame 40
        beams = pattern_directions(pattern, 1777, frame, 10.0)
        assert beams.shape == (lines, 1777, 3)
        time_s = frame / 10 + np.arange(1777) / 17770
        for line in range(lines):
            truth = towards(*rosette(time_s, turn=0.1 * line))
            apart = np.degrees(np.arccos(np.clip((beams[line] * truth).sum(-1), -1, 1)))
            # 2000 points a second, 41 turns in 4 s: chords of 1.8 deg of an arc of 19 deg.
            assert apart.max() < 0.01
        assert np.abs(np.linalg.norm(beams, axis=-1) - 1).max() < 1e-12


def test_every_frame_sees_the_next_part_and_the_whole_fills_up(write):
    pattern = load_scan_pattern(write())
    frames = [pattern_directions(pattern, 2000, k, 10.0)[0] for k in range(41)]
    assert np.abs(frames[0] - frames[40]).max() < 1e-9
    assert np.abs(frames[0] - frames[1]).max() > 0.1

    def cells(beams):
        return len({tuple(cell) for cell in np.floor(beams[:, 1:] / 0.01).astype(int)})

    covered = [cells(np.concatenate(frames[:count])) for count in (1, 4, 16, 40)]
    assert covered[0] < covered[1] < covered[2] < covered[3]
    assert covered[3] > 2 * covered[0]


def test_the_way_between_points_is_the_short_one_across_the_back(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("# period_s: 2\ntime_s,azimuth_deg,elevation_deg\n0,179,0\n1,-179,0\n")
    beams = pattern_directions(load_scan_pattern(path), 4, 0, 0.5)[0]
    azimuth = np.degrees(np.arctan2(beams[:, 1], beams[:, 0]))
    assert np.abs(azimuth) == pytest.approx([179, 180, 179, 180], abs=1e-9)


HEAD = "time_s,azimuth_deg,elevation_deg\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        (HEAD, "0 points"),
        (HEAD + "0,0,0\n", "1 points"),
        ("time_s,azimuth_deg\n0,0\n1,0\n", "no elevation_deg"),
        (HEAD + "0,0,0\n1,nan,0\n", r"azimuth_deg\[1\]: nan"),
        (HEAD + "0,0,0\n1,0,91\n", r"elevation_deg\[1\]: 91"),
        (HEAD + "0,0,0\n1,0\n", "line 3: has 2 values for 3"),
        (HEAD + "0,0,0\nx,0,0\n", "line 3: 'x' is not a number"),
        (HEAD + "0,0,0\n0,1,0\n", r"time_s\[1\]: 0 s is not after"),
        (HEAD + "-1,0,0\n0,1,0\n", r"time_s\[0\]: -1"),
        ("# period_s: 0.5\n" + HEAD + "0,0,0\n1,1,0\n", "period_s: 0.5 s is shorter"),
        ("time_s,azimuth_deg,elevation_deg,line\n0,0,0,0.5\n1,0,0,0.5\n", "line: is not a whole"),
        ("time_s,azimuth_deg,elevation_deg,line\n0,0,0,0\n1,0,0,1e6\n", r"line\[1\]"),
    ],
)
def test_a_wrong_table_is_one_clear_line(tmp_path, text, told):
    path = tmp_path / "p.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=told) as caught:
        load_scan_pattern(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_wrong_npz_is_one_clear_line(tmp_path):
    path = tmp_path / "p.npz"
    good = {"time_s": np.arange(3.0), "azimuth_deg": np.zeros(3), "elevation_deg": np.zeros(3)}
    for wrong, told in [
        ({"azimuth_deg": np.zeros((3, 2))}, "azimuth_deg: is not a list"),
        ({"azimuth_deg": np.array(["a", "b", "c"])}, "azimuth_deg: is not a list"),
        ({"azimuth_deg": np.zeros(2)}, "unequal length"),
        ({"azimuth_deg": np.array([{}], object)}, "is not readable"),
        ({"period_s": np.array("x")}, "period_s: is not a number"),
    ]:
        np.savez(path, **{**good, **wrong})
        with pytest.raises(InputError, match=told):
            load_scan_pattern(path)
    path.write_bytes(b"PK\x03\x04 no")
    with pytest.raises(InputError, match="is not readable"):
        load_scan_pattern(path)
    bomb = io.BytesIO()
    with (
        zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as packed,
        packed.open("time_s.npy", "w") as member,
    ):
        for _ in range(410):
            member.write(bytes(1_000_000))
    path.write_bytes(bomb.getvalue())
    with pytest.raises(InputError, match="unpacks to more than"):
        load_scan_pattern(path)
    with pytest.raises(InputError, match="not found"):
        load_scan_pattern(tmp_path / "none.npz")
