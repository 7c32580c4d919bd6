"""Files of every kind that say who made them, where and when; and files that say nothing."""

import bz2
import gzip
import io
import json
import struct
import tarfile
import zipfile
from pathlib import Path

import laspy
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer
from PIL import Image, PngImagePlugin

from urbantwin.artefact.privacy import names_here, search_files
from urbantwin.artefact.privacy.rules import in_text, in_value

WHO, HOME = "jdoe.secret", "/home/jdoe.secret/scans"


def kinds(path: Path, **names) -> set[str]:
    return {one.what for one in search_files(path, **names)}


def picture(path: Path) -> None:
    image = Image.new("RGB", (4, 4))
    exif = Image.Exif()
    exif[0x013B], exif[0x0132] = WHO, "2021:07:25 13:03:01"  # Artist, DateTime
    exif.get_ifd(0x8825)[1] = "N"  # GPSInfo
    image.save(path, exif=exif)


def png(path: Path) -> None:
    told = PngImagePlugin.PngInfo()
    told.add_text("Creation Time", "Sun, 25 Jul 2021 13:03:01")
    told.add_text("Source", f"{HOME}/a.blend")
    Image.new("RGB", (4, 4)).save(path, pnginfo=told)


def tiff(path: Path) -> None:
    Image.new("L", (4, 4)).save(path, tiffinfo={316: "jdoes-laptop", 306: "2021:07:25 13:03:01"})


def las(path: Path) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.system_identifier = "Scanner of jdoe"
    cloud = laspy.LasData(header)
    cloud.x = cloud.y = cloud.z = np.arange(5.0)
    cloud.gps_time = 3.0e8 + np.arange(5.0)
    cloud.write(path)


def archive(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as packed:
        one = zipfile.ZipInfo("a/notes.txt", (2021, 7, 25, 13, 3, 0))
        packed.writestr(one, f"made in {HOME}")


def tar(path: Path) -> None:
    with tarfile.open(path, "w") as packed:
        one = tarfile.TarInfo("a.json")
        data = json.dumps({"author": WHO}).encode()
        one.size, one.uname, one.mtime = len(data), "jdoe", 1_627_218_181
        packed.addfile(one, io.BytesIO(data))


def parquet(path: Path) -> None:
    times = pa.array([1_627_218_181_000_000], pa.timestamp("us"))
    table = pa.table(
        {"host": ["jdoes-laptop"], "at": times, "begin_ns": [1_627_218_181_000_000_000]}
    )
    pq.write_table(table.replace_schema_metadata({"source": HOME}), path)


def packed_arrays(path: Path) -> None:
    np.savez(path, about=np.array(json.dumps({"file": f"{HOME}/a.pcap"})))


def gzipped(path: Path) -> None:
    with (
        path.open("wb") as stream,
        gzip.GzipFile(f"{HOME}/a.txt", "wb", fileobj=stream, mtime=1_627_218_181) as packed,
    ):
        packed.write(b'<node user="jdoe" timestamp="2021-07-25T13:03:01Z"/>')


def mcap(path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="recorder")
        schema = writer.register_schema("driver", "jsonschema", b"{}")
        channel = writer.register_channel("/driver", "json", schema)
        writer.add_metadata("where", {"file": f"{HOME}/a.pcap"})
        data = json.dumps({"user": WHO}).encode()
        writer.add_message(channel, 1_627_218_181_000_000_000, data, 1_627_218_181_000_000_000)
        writer.finish()


CASES = {
    "a.jpg": (picture, {"name of a person", "time stamp", "place of a camera"}),
    "a.png": (png, {"absolute path", "time stamp"}),
    "a.tif": (tiff, {"name of a person", "time stamp"}),
    "a.las": (las, {"name of a device", "time stamp"}),
    "a.mcap": (mcap, {"absolute path", "name of a person", "time stamp"}),
    "a.zip": (archive, {"absolute path", "time stamp"}),
    "a.tar": (tar, {"name of a person", "time stamp"}),
    "a.parquet": (parquet, {"absolute path", "name of a person", "time stamp"}),
    "a.npz": (packed_arrays, {"absolute path"}),
    "a.gz": (gzipped, {"name of a person", "time stamp"}),
}


@pytest.mark.parametrize("name", CASES)
def test_metadata_of_binary_files_are_searched(tmp_path: Path, name: str) -> None:
    write, expected = CASES[name]
    write(tmp_path / name)
    assert expected <= kinds(tmp_path)


TEXTS = {
    "a.osm": '<node id="1" user="jdoe" uid="7" timestamp="2021-07-25T13:03:01Z"/>\n',
    "a.yaml": f"osm:\n  file: {HOME}/map.osm\n",
    "a.csv": "track,mail\n1,j.doe@example.org\n",
    "a.ply": f"ply\nformat ascii 1.0\ncomment by {HOME}\nend_header\n",
    "a.json": json.dumps({"recorded": {"begins_s": 1_627_218_181.25, "plate": "B-MW 1234"}}),
    "a.geojson": json.dumps({"features": [{"properties": {"created_by": "jdoe"}}]}),
    "a.html": "<p>C:\\Users\\jdoe\\scan</p>",
    "a.xodr": f'<OpenDRIVE><header name="{HOME}/a"/></OpenDRIVE>',
}


@pytest.mark.parametrize("name", TEXTS)
def test_texts_are_searched(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(TEXTS[name])
    assert search_files(tmp_path)


def test_letters_of_a_las_that_counts_records_which_it_lacks_are_searched(tmp_path: Path) -> None:
    las(tmp_path / "a.las")
    data = bytearray((tmp_path / "a.las").read_bytes())
    struct.pack_into("<I", data, 100, 2**32 - 1)  # laspy would read so many from nothing
    (tmp_path / "a.las").write_bytes(bytes(data) + bytes(4) + HOME.encode() + bytes(4))
    assert HOME in {one.text for one in search_files(tmp_path)}


def test_the_line_and_the_byte_are_those_of_the_file(tmp_path: Path) -> None:
    data = f"ä one\ntwo\n  see {HOME}/x\n".encode()
    (tmp_path / "a.txt").write_bytes(data)
    (found,) = search_files(tmp_path / "a.txt")
    assert found.place == f"line 3 (byte {data.index(HOME.encode())})"
    assert found.text == f"{HOME}/x"
    (tmp_path / "a.bin").write_bytes(struct.pack("<8I", *range(8)) + HOME.encode() + bytes(9))
    (found,) = search_files(tmp_path / "a.bin")
    assert found.place == "byte 32"


def test_points_are_no_words_and_times_of_a_motion_no_moments(tmp_path: Path) -> None:
    # Coordinates that read as `~NfB/T` and `B:/N@`, as measured ones did.
    rows = np.zeros((40, 4), "<f4")
    rows[7, :3] = np.frombuffer(b"ab0A ~fB/T0A", "<f4")
    rows[9, :3] = np.frombuffer(b"01 B:/N@tuBA", "<f4")
    (tmp_path / "000000.bin").write_bytes(rows.tobytes())
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.generating_software, header.system_identifier = "UrbanTwin 0.1.0", "UrbanTwin"
    cloud = laspy.LasData(header)
    cloud.x = cloud.y = cloud.z = np.arange(5.0)
    cloud.gps_time = np.arange(5.0) / 50
    cloud.write(tmp_path / "000000.las")
    assert not search_files(tmp_path)
    (tmp_path / "000001.bin").write_bytes(rows.tobytes() + HOME.encode() + bytes(3))
    assert kinds(tmp_path) == {"absolute path"}


def test_names_of_files_and_names_that_are_given_are_looked_for(tmp_path: Path) -> None:
    (tmp_path / "scan_jdoe.bin").write_bytes(b"\0\1\2\3")
    (tmp_path / "b.txt").write_text("JDOE did it, and jdoeish things\n")
    names = {"jdoe": "name of the user"}
    found = search_files(tmp_path, names=names)
    assert [(one.file, one.what) for one in found] == [
        ("b.txt", "name of the user"),
        ("scan_jdoe.bin", "name of the user"),
    ]
    assert search_files(tmp_path) == []


def test_this_machine_s_names_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOGNAME", "mmustermann")
    monkeypatch.setenv("HOME", "/home/mmustermann")
    names = names_here()
    assert names["mmustermann"] == "name of the user"
    assert names["/home/mmustermann"] == "home folder"
    monkeypatch.setenv("LOGNAME", "root")
    assert "root" not in names_here()


def test_many_findings_of_a_kind_are_counted_and_hide_no_other(tmp_path: Path) -> None:
    lines = [f'<node timestamp="2021-07-25T13:{k:02}:01Z"/>' for k in range(40)]
    (tmp_path / "a.osm.bz2").write_bytes(bz2.compress("\n".join([*lines, HOME + "/a"]).encode()))
    found = search_files(tmp_path)
    assert {"time stamp", "absolute path"} == {one.what for one in found}
    assert any(one.text == "35 more" for one in found)


@pytest.mark.parametrize(
    "text",
    [
        "CreationTime 1970-01-01 10:00:00:000",  # as Assimp writes it
        "km/h and/or text/html",
        "https://example.org/home/page",
        "</home/x>",
        "/lidar/points",
        "/Game/Carla/Maps/a",
        "icon@2x.png",
        "2021-07-25",
        "2000-01-01T00:00:00",
        'author="UrbanTwin"',
        "points/NNNNNN.npy: (N, 4) float32",
        "Mo-Fr 09:00-15:00, 18:00-07:00",
        "4.4.0.post1",
    ],
)
def test_what_says_nothing_of_anybody(text: str) -> None:
    assert list(in_text(text)) == []


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("time_s", 19.9, False),
        ("begins_s", 1_627_218_181.5, True),
        ("timestamp", 1_627_218_181_000_000, True),
        ("id", 1_627_218_181, False),  # a node of OpenStreetMap's
        ("author", "UrbanTwin", False),
        ("username", "jdoe", True),
        ("user", "", False),
        ("licence_plate", "B-MW 1234", True),
    ],
)
def test_fields_are_judged_by_their_names(field: str, value: object, told: bool) -> None:
    assert bool(list(in_value(field, value))) == told


def test_a_damaged_file_is_searched_by_its_letters(tmp_path: Path) -> None:
    parquet(tmp_path / "a.parquet")
    data = (tmp_path / "a.parquet").read_bytes()
    (tmp_path / "a.parquet").write_bytes(data[:-20])
    assert "absolute path" in kinds(tmp_path)


def test_seconds_from_the_start_of_a_drive_are_no_time_of_day(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.system_identifier = header.generating_software = ""
    cloud = laspy.LasData(header)
    cloud.x = cloud.y = cloud.z = np.arange(5.0)
    cloud.gps_time = np.linspace(0.0, 0.1, 5)
    cloud.write(tmp_path / "points.las")
    assert search_files(tmp_path) == []
    cloud.gps_time = np.linspace(0.0, 0.1, 5) + 270_000.0  # seconds of a week
    cloud.write(tmp_path / "points.las")
    assert [one.what for one in search_files(tmp_path)] == ["time stamp"]
