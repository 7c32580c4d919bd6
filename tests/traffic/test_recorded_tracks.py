"""Recorded tracks: one path in every format, and what cannot be tracks."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.traffic.recorded import Recording, read_recording

FRAME = SiteFrame(50.0, 8.0)
RATE_HZ, COUNT, SPEED_MS = 10, 41, 8.0
HEADING = np.radians(30.0)
SIZE = (4.4, 1.8, 1.5)
TIMES = np.arange(COUNT) / RATE_HZ
AHEAD = np.array([np.cos(HEADING), np.sin(HEADING)])
XY = np.array([-12.0, 3.0]) + SPEED_MS * TIMES[:, None] * AHEAD
HALF = HEADING / 2


def csv_of(header: str, rows: list[tuple[object, ...]]) -> str:
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n"


def plain(folder: Path) -> Path:
    rows = [(7, t, "Car", x, y, HEADING, *SIZE) for t, (x, y) in zip(TIMES, XY, strict=True)]
    header = "track_id,time_s,class,x,y,yaw_rad,length,width,height"
    (folder / "tracks.csv").write_text(csv_of(header, rows))
    return folder / "tracks.csv"


def described(folder: Path) -> Path:
    """In UTM, milliseconds, degrees from north, the front bumper, in columns of other names."""
    utm = Transformer.from_crs(FRAME.proj_with_datum, "EPSG:25832", always_xy=True)
    front = XY + AHEAD * SIZE[0] / 2
    east, north = utm.transform(*front.T)
    ahead = np.column_stack(utm.transform(*(front + AHEAD).T)) - np.column_stack([east, north])
    bearing = np.degrees(np.pi / 2 - np.arctan2(ahead[:, 1], ahead[:, 0]))
    rows = [
        ("a", 1600 + 1000 * t, "Pkw", e, n, b, *SIZE)
        for t, e, n, b in zip(TIMES, east, north, bearing, strict=True)
    ]
    (folder / "utm.csv").write_text(csv_of("who;when;what;E;N;dir;l;w;h".replace(";", ","), rows))
    (folder / "utm.yaml").write_text(
        "tracks: utm.csv\ncrs: EPSG:25832\nheading: north-clockwise\npoint: front\n"
        "units: {time: ms, angle: deg}\nclasses: {Pkw: car}\n"
        "columns: {track: who, time: when, class: what, x: E, y: N, yaw: dir}\n"
    )
    return folder / "utm.yaml"


def geographic(folder: Path) -> Path:
    lonlat = FRAME.lonlat_from_site(XY)
    rows = [
        (7, k, "passenger_car", lon, lat, *SIZE) for k, (lon, lat) in enumerate(lonlat.tolist())
    ]
    header = "id,frame,type,longitude,latitude,length,width,height"
    (folder / "degrees.csv").write_text(csv_of(header, rows))
    (folder / "degrees.yaml").write_text(f"tracks: degrees.csv\nrate_hz: {RATE_HZ}\n")
    return folder / "degrees.yaml"


def openlabel(folder: Path) -> Path:
    quaternion = (0.0, 0.0, np.sin(HALF), np.cos(HALF))
    frames = {
        str(k): {
            "frame_properties": {"timestamp": f"2020-09-15T16:06:{14 + t:06.3f}"},
            "objects": {
                "car-7": {
                    "object_data": {
                        "cuboid": [{"name": "shape3D", "val": [x, y, 0.7, *quaternion, *SIZE]}]
                    }
                }
            },
        }
        for k, (t, (x, y)) in enumerate(zip(TIMES, XY, strict=True))
    }
    objects = {"car-7": {"name": "car-7", "type": "CAR"}}
    whole = {"metadata": {"schema_version": "1.0.0"}, "objects": objects, "frames": frames}
    (folder / "labels.json").write_text(json.dumps({"openlabel": whole}))
    return folder / "labels.json"


def nuscenes(folder: Path) -> Path:
    rotation = [np.cos(HALF), 0.0, 0.0, np.sin(HALF)]
    annotations = [
        {
            "token": f"n{k}",
            "sample_token": f"s{k}",
            "instance_token": "i7",
            "translation": [x, y, 0.7],
            "size": [SIZE[1], SIZE[0], SIZE[2]],
            "rotation": rotation,
        }
        for k, (x, y) in enumerate(XY.tolist())
    ]
    tables = {
        "sample_annotation": annotations,
        "sample": [
            {"token": f"s{k}", "timestamp": 1_532_402_927_000_000 + k * 100_000}
            for k in range(COUNT)
        ],
        "instance": [{"token": "i7", "category_token": "c"}],
        "category": [{"token": "c", "name": "vehicle.car"}],
    }
    for name, table in tables.items():
        (folder / f"{name}.json").write_text(json.dumps(table))
    return folder / "sample_annotation.json"


def submission(folder: Path) -> Path:
    nuscenes(folder)
    found = json.loads((folder / "sample_annotation.json").read_text())
    for one in found:
        one |= {"tracking_id": "7", "tracking_name": "car", "tracking_score": 0.9}
    results = {one["sample_token"]: [one] for one in found}
    (folder / "tracking.json").write_text(json.dumps({"meta": {}, "results": results}))
    return folder / "tracking.json"


def kitti(folder: Path) -> Path:
    """As a camera saw it that looks north from (5, -20), 2 m above the ground."""
    relative = XY - [5.0, -20.0]
    right, ahead = relative[:, 0], relative[:, 1]
    # Rotation about y (down) from x (right): positive turns right, as a compass does.
    turned = -HEADING
    lines = [
        f"{k} 7 Car 0 0 -10 0 0 1 1 {SIZE[2]} {SIZE[1]} {SIZE[0]} {r} 2.0 {a} {turned}"
        for k, (r, a) in enumerate(zip(right, ahead, strict=True))
    ]
    lines.append("3 -1 DontCare -1 -1 -10 0 0 1 1 -1 -1 -1 -1000 -1000 -1000 -10")
    (folder / "0000.txt").write_text("\n".join(lines) + "\n")
    (folder / "kitti.yaml").write_text(
        "tracks: 0000.txt\npose: {x: 5.0, y: -20.0, z: 2.0, yaw_deg: 90.0}\n"
    )
    return folder / "kitti.yaml"


def openscenario(folder: Path) -> Path:
    """By the rear axle, 1.3 m behind the middle of the box."""
    rear = XY - 1.3 * AHEAD
    vertices = "".join(
        f'<Vertex time="{t}"><Position><WorldPosition x="{x}" y="{y}" z="0" h="{HEADING}"/>'
        "</Position></Vertex>"
        for t, (x, y) in zip(TIMES, rear, strict=True)
    )
    length, width, height = SIZE
    (folder / "one.xosc").write_text(
        '<OpenSCENARIO><Entities><ScenarioObject name="Ego"><Vehicle name="v" '
        'vehicleCategory="car"><BoundingBox><Center x="1.3" y="0" z="0.75"/>'
        f'<Dimensions length="{length}" width="{width}" height="{height}"/></BoundingBox>'
        "</Vehicle></ScenarioObject></Entities><Storyboard><Story><Act><ManeuverGroup>"
        '<Actors><EntityRef entityRef="Ego"/></Actors><Maneuver><Event><Action><PrivateAction>'
        "<RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory><Shape><Polyline>"
        f"{vertices}</Polyline></Shape></Trajectory></TrajectoryRef></FollowTrajectoryAction>"
        "</RoutingAction></PrivateAction></Action></Event></Maneuver></ManeuverGroup></Act>"
        "</Story></Storyboard></OpenSCENARIO>"
    )
    return folder / "one.xosc"


FORMATS = (plain, described, geographic, openlabel, nuscenes, submission, kitti, openscenario)


@pytest.mark.parametrize("written", FORMATS, ids=lambda one: one.__name__)
def test_every_format_gives_the_same_track(written: Callable[[Path], Path], tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path), FRAME)
    (track,) = recording.tracks
    assert track.actor_class == "car"
    assert track.time_s == pytest.approx(TIMES, abs=2e-6)
    assert recording.duration_s == pytest.approx(TIMES[-1], abs=2e-6)
    assert np.abs(track.xy - XY).max() < 1e-3
    assert track.size == pytest.approx(SIZE)
    if written is not geographic:
        assert np.abs(np.angle(np.exp(1j * (track.yaw - HEADING)))).max() < 1e-6
    assert bool(recording.assumed) == (written not in (described, geographic, kitti))


def test_signals_are_told_where_they_change(tmp_path: Path) -> None:
    plain(tmp_path)
    states = ["STOP_AND_REMAIN"] * 3 + ["PRE_MOVEMENT"] + ["PROTECTED_MOVEMENT_ALLOWED"] * 2
    rows = [(4, k * 100, state) for k, state in enumerate(states)]
    header = "signal_group_id,timestamp_ms,movement_state"
    (tmp_path / "spat.csv").write_text(csv_of(header, rows))
    (tmp_path / "d.yaml").write_text(
        "tracks: tracks.csv\nsignals: {file: spat.csv, places: {4: [[1.5, 2.5]]}}\n"
    )
    signals = read_recording(tmp_path / "d.yaml", FRAME).signals
    assert signals is not None
    assert signals.shown == {"4": ((0.0, "r"), (0.3, "u"), (0.4, "G"))}
    assert signals.places == {"4": ((1.5, 2.5),)}


def read_with(folder: Path, change: Callable[[list[str]], object]) -> Recording:
    lines = plain(folder).read_text().splitlines()
    change(lines)
    (folder / "tracks.csv").write_text("\n".join(lines) + "\n")
    return read_recording(folder / "tracks.csv", FRAME)


def changed(line: int, old: str, new: str) -> Callable[[list[str]], object]:
    def change(lines: list[str]) -> None:
        assert old in lines[line - 1]
        lines[line - 1] = lines[line - 1].replace(old, new)

    return change


def on_foot(lines: list[str]) -> None:
    """Six metres in a tenth of a second: a car's, on a motorway, and a template's error."""
    lines[1:] = [line.replace("Car", "Pedestrian") for line in lines[1:]]
    row = lines[11].split(",")
    row[3] = str(float(row[3]) + 6.0)
    lines[11] = ",".join(row)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (changed(12, "7,1.0,", "7,0.85,"), ["line 12", "time goes back", "0.85"]),
        (changed(12, "7,1.0,", "7,0.9,"), ["line 12", "time stands still"]),
        (changed(10, "Car,-", "Car,9"), ["line 10", "jumps", "in 0.1 s"]),
        (changed(42, "7,4.0,Car,", "7,4.0,Car,1"), ["line 42", "jumps", "no car faster than 70"]),
        (on_foot, ["line 12", "jumps", "no pedestrian faster than 12 m/s"]),
        (changed(5, "0.3,Car", "0.3,Car,x"), ["line 5"]),
        (changed(9, "Car", "Cxr"), []),
        (changed(3, ",4.4,", ",four,"), ["line 3", "length", "'four'", "a number"]),
        (changed(3, "7,0.1", "7,"), ["line 3", "time_s", "a number"]),
        (changed(1, ",x,", ",east,"), ["line 1", "no column of", "columns:"]),
        (lambda lines: lines.__delitem__(slice(1, None)), ["no rows"]),
    ],
)
def test_a_wrong_row_is_named(
    change: Callable[[list[str]], object], told: list[str], tmp_path: Path
) -> None:
    if not told:  # one odd name among many is no other class: the track is what it is called most
        assert read_with(tmp_path, change).tracks[0].actor_class == "car"
        return
    with pytest.raises(InputError) as error:
        read_with(tmp_path, change)
    for words in ("tracks.csv", *told):
        assert words in str(error.value), str(error.value)


def test_an_unknown_class_and_another_crs_are_told(tmp_path: Path) -> None:
    def all_hovercraft(lines: list[str]) -> None:
        lines[1:] = [line.replace("Car", "hovercraft") for line in lines[1:]]

    with pytest.raises(InputError, match=r"line 2: unknown class 'hovercraft'.*classes:.*ignore"):
        read_with(tmp_path, all_hovercraft)
    utm = described(tmp_path)
    utm.write_text(utm.read_text().replace("crs: EPSG:25832\n", ""))
    with pytest.raises(InputError, match=r"line \d+: no track comes near the site.*km away"):
        read_recording(utm, FRAME)
    utm.write_text("tracks: utm.csv\ncrs: EPSG:999999\n")
    with pytest.raises(InputError, match=r"(?s)utm.*"):
        read_recording(utm, FRAME)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("tracks: tracks.csv\ncolumn: {}\n", "column"),
        ("tracks: tracks.csv\ncolumns: {speeed: v}\n", r"columns \(line 2\).*speeed"),
        ("tracks: tracks.csv\nclasses: {Car: auto}\n", r"classes \(line 2\).*'auto'"),
        ("tracks: none.csv\n", "none.csv: not found"),
        ("tracks: tracks.xyz\n", "unknown format"),
        (
            "tracks: tracks.csv\ncrs: EPSG:25832\npose: {x: 1.0}\n",
            r"pose.*one of origin, crs and pose",
        ),
    ],
)
def test_a_wrong_description_is_told(text: str, told: str, tmp_path: Path) -> None:
    plain(tmp_path)
    (tmp_path / "d.yaml").write_text(text)
    with pytest.raises(InputError, match=told):
        read_recording(tmp_path / "d.yaml", FRAME)
