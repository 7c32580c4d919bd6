"""Files beside a model, as each program's documentation or users show them."""

import struct

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational
from pyproj import CRS, Transformer
from scipy.spatial.transform import Rotation

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame

from ..reconstruct.model_files import FRAME, read

UTM = "EPSG:32631"
#: A little model around the anchor, east-north-up metres.
SHAPE = np.array([[0, 0, 0], [30, 0, 0], [0, 20, 0], [0, 0, 10.0]])


def in_system(crs, height=43.0):
    """The model's corners in another system."""
    lonlat = FRAME.lonlat_from_site(SHAPE[:, :2])
    to = Transformer.from_crs("EPSG:4979", crs, always_xy=True)
    return np.column_stack(to.transform(lonlat[:, 0], lonlat[:, 1], SHAPE[:, 2] + height))


def obj(path, points, comments=()):
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [*comments, *("v {!r} {!r} {!r}".format(*map(float, p)) for p in points)]
    path.write_text("\n".join([*lines, "f 1 2 3", "f 1 2 4"]) + "\n")
    return path


def test_pix4d_offset_and_projection(tmp_path):
    offset = np.round(in_system(UTM)[0], -2)
    (tmp_path / "quarry_offset.xyz").write_text("{} {} {}\n".format(*offset))
    (tmp_path / "quarry_wkt.prj").write_text(CRS(UTM).to_wkt("WKT1_GDAL"))
    model = read(obj(tmp_path / "quarry_simplified_3d_mesh.obj", in_system(UTM) - offset))
    assert model.crs.to_epsg() == 32631
    assert model.up == "z"
    assert np.allclose(model.mesh.vertices, in_system(UTM))
    assert set(model.files) == {
        "quarry_simplified_3d_mesh.obj",
        "quarry_offset.xyz",
        "quarry_wkt.prj",
    }


def test_metashape_projection_beside_a_model(tmp_path):
    (tmp_path / "m.prj").write_text(CRS(UTM).to_wkt("WKT1_ESRI"))
    model = read(obj(tmp_path / "m.obj", in_system(UTM)))
    assert CRS(UTM).equals(model.crs, ignore_axis_order=True) or model.crs.to_epsg() == 32631


@pytest.mark.parametrize("folder", [".", "Data/Tile_+000_+000"])
def test_context_capture_metadata(tmp_path, folder):
    origin = np.round(in_system(UTM)[0])
    (tmp_path / "metadata.xml").write_text(
        '<?xml version="1.0" encoding="utf-8"?>\n<ModelMetadata version="1">\n'
        "<!--Spatial Reference System--><SRS>EPSG:32631+5773</SRS>\n"
        "<SRSOrigin>{},{},{}</SRSOrigin>\n</ModelMetadata>\n".format(*origin)
    )
    model = read(obj(tmp_path / folder / "t.obj", in_system(UTM) - origin))
    assert [part.to_epsg() for part in model.crs.sub_crs_list] == [32631, 5773]
    assert np.allclose(model.mesh.vertices, in_system(UTM))


def test_open_drone_map_coordinates(tmp_path):
    origin = np.round(in_system(UTM)[0, :2])
    folder = tmp_path / "odm_georeferencing"
    folder.mkdir()
    (folder / "coords.txt").write_text("WGS84 UTM 31N\n{:.0f} {:.0f}\n".format(*origin))
    points = in_system(UTM) - [*origin, 0]
    model = read(obj(tmp_path / "odm_texturing" / "odm_textured_model_geo.obj", points))
    assert model.crs.to_epsg() == 32631
    assert np.allclose(model.mesh.vertices, in_system(UTM))


def test_comments_of_an_obj(tmp_path):
    origin = np.round(in_system(UTM)[0])
    comments = ["# crs: EPSG:32631", "# offset: {} {} {}".format(*origin)]
    model = read(obj(tmp_path / "m.obj", in_system(UTM) - origin, comments))
    assert model.crs.to_epsg() == 32631
    assert np.allclose(model.mesh.vertices, in_system(UTM))


def test_control_points_are_in_the_coordinates_of_the_file(tmp_path):
    (tmp_path / "m_offset.xyz").write_text("1000 2000 3000")
    points = [{"model": p.tolist(), "site_m": p.tolist()} for p in SHAPE]
    model = read(obj(tmp_path / "m.obj", SHAPE), control_points=points)
    assert np.allclose(model.mesh.vertices, SHAPE)


def test_parts_of_an_export_are_one_model_and_a_bad_part_is_told(tmp_path):
    folder = tmp_path / "export"
    for number in range(3):
        obj(folder / f"m_000000{number}.obj", SHAPE + [40 * number, 0, 0])
    (folder / "m_0000003.obj").write_text("v 0 0 0\nf 1 2 3\n")
    (folder / "m_0000000.png").write_bytes(b"")
    model = read(folder, kind="photogrammetry")
    assert len(model.mesh.faces) == 6
    assert model.notes["parts"] == 3
    assert "m_0000003.obj" in model.problems[0]


def test_only_the_finest_level_of_a_tile_is_read(tmp_path):
    folder = tmp_path / "Data"
    for level in (15, 17, 16):
        obj(folder / f"Tile_+000_+001_L{level}_00.obj", SHAPE * level)
    model = read(folder)
    assert list(model.files) == ["Tile_+000_+001_L17_00.obj"]


# COLMAP's documentation, "Output Format".


def images(turn, shift, scale):
    """Nine images in a ring, and where they are in the reconstruction."""
    angle = np.arange(9) * 0.7
    east, north = 25 * np.cos(angle), 18 * np.sin(angle)
    enu = np.column_stack([east, north, 60 + 4 * np.sin(3 * angle)])
    names = [f"img{k}.jpg" for k in range(9)]
    return names, enu, (enu - shift) @ turn / scale


def image_rows(names, centres, seed=3):
    rotations = Rotation.random(len(names), rng=np.random.default_rng(seed))
    for number, (name, centre) in enumerate(zip(names, centres, strict=True), 1):
        rotation = rotations[number - 1]
        quaternion = np.roll(rotation.as_quat(), 1)  # COLMAP has w first
        yield number, quaternion, -rotation.apply(centre), name


def colmap(folder, names, centres, points, *, binary):
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    if not binary:
        lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[]"]
        for number, q, t, name in image_rows(names, centres):
            lines += [
                " ".join(map(repr, [number, *map(float, [*q, *t]), 1])) + f" {name}",
                "1.0 2.0 -1",
            ]
        (sparse / "images.txt").write_text("\n".join(lines) + "\n")
        rows = [
            f"{k} {x!r} {y!r} {z!r} 10 20 30 0.5 1 2 3 4"
            for k, (x, y, z) in enumerate(points.tolist())
        ]
        (sparse / "points3D.txt").write_text(
            "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n" + "\n".join(rows)
        )
        return
    data = struct.pack("<Q", len(names))
    for number, q, t, name in image_rows(names, centres):
        data += struct.pack("<I7dI", number, *q, *t, 1) + name.encode() + b"\0"
        data += struct.pack("<Q2dq", 1, 1.0, 2.0, -1)
    (sparse / "images.bin").write_bytes(data)
    data = struct.pack("<Q", len(points))
    for number, point in enumerate(points):
        track = number % 3
        data += struct.pack("<Q3d3BdQ", number, *point, 10, 20, 30, 0.5, track)
        data += struct.pack(f"<{2 * track}I", *range(2 * track))
    (sparse / "points3D.bin").write_bytes(data)


def tagged(path, longitude, latitude, height):
    def angle(value):
        whole = int(value)
        minutes = int((value - whole) * 60)
        seconds = round((value - whole - minutes / 60) * 3600 * 10**6)
        return (IFDRational(whole), IFDRational(minutes), IFDRational(seconds, 10**6))

    image = Image.new("RGB", (4, 4))
    exif = Image.Exif()
    exif[0x8825] = {
        1: "N",
        2: angle(latitude),
        3: "E",
        4: angle(longitude),
        5: b"\x00",
        6: IFDRational(round(height * 1000), 1000),
    }
    image.save(path, exif=exif)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("tags", [False, True])
def test_colmap_is_placed_by_where_its_images_were_taken(tmp_path, binary, tags):
    turn = Rotation.from_euler("zyx", [40, 25, -100], degrees=True).as_matrix()
    shift, scale = np.array([3.0, -7.0, 12.0]), 4.5
    names, enu, centres = images(turn, shift, scale)
    truth = np.random.default_rng(4).uniform(-20, 20, (30, 3))
    colmap(tmp_path, names, centres, (truth - shift) @ turn / scale, binary=binary)
    lonlat = FRAME.lonlat_from_site(enu[:, :2])
    if tags:
        (tmp_path / "images").mkdir()
        for name, (lon, lat), height in zip(names, lonlat, enu[:, 2], strict=True):
            tagged(tmp_path / "images" / name, lon, lat, height + 100)
    else:
        rows = [
            f"{name} {lat:.12f} {lon:.12f} {z + 100:.6f}"
            for name, (lon, lat), z in zip(names, lonlat, enu[:, 2], strict=True)
        ]
        rows[2] = rows[2].replace("52.", "52.3")  # one wrong
        (tmp_path / "geo.txt").write_text("\n".join(rows))
    model = read(tmp_path)
    there = SiteFrame(model.geotag.latitude, model.geotag.longitude)
    points = model.cloud.points
    xy = FRAME.site_from_lonlat(there.lonlat_from_site(points[:, :2]))
    found = np.column_stack([xy, points[:, 2] + model.geotag.height_m - 100])
    assert (model.up, model.unit_m) == ("z", 1.0)
    assert np.abs(found - truth).max() < 0.01
    assert model.notes["scale"] == pytest.approx(scale, rel=1e-4)
    assert (model.cloud.colour == [10, 20, 30]).all()


def test_colmap_without_places_is_read_and_told(tmp_path):
    names, _, centres = images(np.eye(3), 0.0, 1.0)
    colmap(tmp_path, names, centres, SHAPE, binary=True)
    model = read(tmp_path)
    assert np.allclose(model.cloud.points, SHAPE)
    assert model.geotag is None
    assert "no places" in model.problems[0]


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.99])
@pytest.mark.parametrize("name", ["points3D.bin", "images.bin"])
def test_colmap_cut_short(tmp_path, name, keep):
    names, _, centres = images(np.eye(3), 0.0, 1.0)
    colmap(tmp_path, names, centres, SHAPE, binary=True)
    path = tmp_path / "sparse" / "0" / name
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data))])
    with pytest.raises(InputError) as caught:
        read(tmp_path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m_offset.xyz", "a b c"),
        ("m.prj", "nonsense"),
        ("metadata.xml", "<ModelMetadata"),
        ("metadata.xml", "<ModelMetadata><SRS>EPSG:1</SRS></ModelMetadata>"),
        ("coords.txt", "WGS84 UTM 31N\nx y"),
        ("metadata.xml", "<ModelMetadata><SRS>ENU:52.01,4.36</SRS></ModelMetadata>"),
    ],
)
def test_what_is_wrong_beside_a_model_is_told_in_a_line(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as caught:
        read(obj(tmp_path / "m.obj", SHAPE))
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
