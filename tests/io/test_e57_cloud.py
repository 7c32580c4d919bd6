"""E57 against another program's writer (libE57Format), at poses in closed form."""

import numpy as np
import pye57
import pytest
from pye57 import libe57

from urbantwin.errors import InputError

from ..reconstruct.model_files import read

#: Turned by 90 degrees about z, and by 180 about x: as quaternions and as what they do.
ABOUT_Z = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
ABOUT_X = np.array([0.0, 1.0, 0.0, 0.0])


def points(count, seed=1):
    return np.random.default_rng(seed).uniform(-20, 20, (count, 3)).astype(np.float32)


def columns(xyz, **more):
    named = {f"cartesian{axis}": xyz[:, k].astype(np.float64) for k, axis in enumerate("XYZ")}
    return named | more


def written(path, *scans):
    """A file of scans: (columns, rotation, translation)."""
    with pye57.E57(str(path), mode="w") as file:
        for data, rotation, translation in scans:
            file.write_scan_raw(data, rotation=rotation, translation=np.array(translation, float))
    return path


def in_order(xyz):
    return xyz[np.lexsort(xyz.T)]


def test_scans_stand_at_their_poses(tmp_path):
    first, second = points(700), points(300, 2)
    path = written(
        tmp_path / "two.e57",
        (columns(first), ABOUT_Z, (100.0, 200.0, 3.0)),
        (columns(second), ABOUT_X, (-5.0, 0.0, 1.0)),
    )
    model = read(path)
    x, y, z = first.T.astype(float)
    u, v, w = second.T.astype(float)
    expected = np.concatenate(
        [np.column_stack([100 - y, 200 + x, 3 + z]), np.column_stack([u - 5, -v, 1 - w])]
    )
    assert np.abs(model.cloud.points - expected).max() < 1e-9
    assert model.notes["scans"] == 2
    assert model.notes["points"] == 1000
    assert (model.up, model.unit_m, model.crs) == ("z", 1.0, None)


def test_colours_rows_and_invalid_points(tmp_path):
    xyz = points(60)
    state = np.repeat([0, 1, 2], 20).astype(np.int8)
    colour = np.arange(180).reshape(60, 3).astype(np.uint8)
    data = columns(
        xyz,
        intensity=np.linspace(0, 1, 60).astype(np.float32),
        rowIndex=np.repeat(np.arange(6), 10).astype(np.uint16),
        columnIndex=np.tile(np.arange(10), 6).astype(np.uint16),
        cartesianInvalidState=state,
        **{f"color{name}": colour[:, k] for k, name in enumerate(("Red", "Green", "Blue"))},
    )
    model = read(written(tmp_path / "a.e57", (data, ABOUT_Z, (0, 0, 0))))
    assert len(model.cloud.points) == 20
    assert model.notes["points_invalid"] == 40
    assert (model.cloud.colour == colour[:20]).all()


def spherical(path, ranges, azimuths, elevations, *, wkt="", bright=65535):
    """A scan of ranges and angles with colours of 16 bits, which pye57's own writer lacks."""
    file = libe57.ImageFile(str(path), "w")
    file.extensionsAdd("", libe57.E57_V1_0_URI)
    root = file.root()
    for name, text in (("formatName", "ASTM E57 3D Imaging Data File"), ("guid", "{1}")):
        root.set(name, libe57.StringNode(file, text))
    for name, number in (("versionMajor", 1), ("versionMinor", 0)):
        root.set(name, libe57.IntegerNode(file, number))
    root.set("coordinateMetadata", libe57.StringNode(file, wkt))
    scans = libe57.VectorNode(file, True)
    root.set("data3D", scans)
    scan = libe57.StructureNode(file)
    limits = libe57.StructureNode(file)
    prototype = libe57.StructureNode(file)
    names = ["sphericalRange", "sphericalAzimuth", "sphericalElevation"]
    for name in names:
        prototype.set(name, libe57.FloatNode(file, 0.0, libe57.E57_DOUBLE, -1e3, 1e3))
    shades = ["colorRed", "colorGreen", "colorBlue"]
    for name in shades:
        limits.set(f"{name}Minimum", libe57.IntegerNode(file, 0, 0, bright))
        limits.set(f"{name}Maximum", libe57.IntegerNode(file, bright, 0, bright))
        prototype.set(name, libe57.IntegerNode(file, 0, 0, bright))
    scan.set("guid", libe57.StringNode(file, "{2}"))
    scan.set("colorLimits", limits)
    node = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    scan.set("points", node)
    scans.append(scan)
    buffers = libe57.VectorSourceDestBuffer()
    rows = [*np.array([ranges, azimuths, elevations], float), *np.full((3, len(ranges)), bright)]
    kept = [np.ascontiguousarray(row, np.float64) for row in rows]
    for name, row in zip([*names, *shades], kept, strict=True):
        buffers.append(libe57.SourceDestBuffer(file, name, row, len(row), True, True))
    writer = node.writer(buffers)
    writer.write(len(ranges))
    writer.close()
    file.close()
    return path


def test_ranges_and_angles(tmp_path):
    model = read(spherical(tmp_path / "s.e57", [10, 20, 2], [0, np.pi / 2, 0], [0, 0, np.pi / 6]))
    expected = [[10, 0, 0], [0, 20, 0], [np.sqrt(3), 0, 1]]
    assert np.abs(model.cloud.points - expected).max() < 1e-9
    assert (model.cloud.colour == 255).all()


def test_a_system_that_the_file_names(tmp_path):
    """WKT in coordinateMetadata: then only what lies about the site is kept."""
    from pyproj import CRS, Transformer

    change = Transformer.from_crs("EPSG:4326", "EPSG:28992", always_xy=True)
    x, y = change.transform(4.36, 52.01)
    far = float(np.hypot(x, y))
    angle = float(np.arctan2(y, x))
    wkt = CRS.from_epsg(28992).to_wkt()
    path = tmp_path / "s.e57"
    # The writer above bounds ranges by 1 km: two points in kilometres would be out of it.
    ranges = np.array([far, far + 500.0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(libe57, "FloatNode", _wide(libe57.FloatNode))
        spherical(path, ranges, [angle, angle], [0, 0], wkt=wkt)
    model = read(path)
    assert model.crs.to_epsg() == 28992
    assert len(model.cloud.points) == 1
    assert model.cloud.points[0, :2] == pytest.approx([x, y], abs=1e-6)


def _wide(make):
    def node(file, value, precision, low, high):
        return make(file, value, precision, 1e4 * low, 1e4 * high)

    return node


def test_damage_is_one_line(tmp_path):
    whole = written(tmp_path / "a.e57", (columns(points(5000)), ABOUT_Z, (0, 0, 0))).read_bytes()
    flipped = bytearray(whole)
    flipped[3000] ^= 0xFF
    bent = written(tmp_path / "b.e57", (columns(points(9)), 2 * ABOUT_Z, (0, 0, 0))).read_bytes()
    for content, says in (
        (whole[: len(whole) // 2], "is truncated"),
        (whole[:30], "truncated within its header"),
        (b"ASTM-E57", "truncated within its header"),
        (bytes(flipped), "cannot be read as E57"),
        (b"ASTM-E57" + b"\xff" * 2000, "not E57 of version 1"),
        (bent, "no rotation and translation"),
    ):
        path = tmp_path / "bad.e57"
        path.write_bytes(content)
        with pytest.raises(InputError, match=says) as error:
            read(path)
        assert "bad.e57" in str(error.value)
        assert "\n" not in str(error.value)
        assert path.read_bytes() == content  # nothing of it is removed
