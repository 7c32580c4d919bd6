import tracemalloc

import laspy
import numpy as np
import pytest
import shapely
from laspy.vlrs.known import GeoKeyDirectoryVlr, GeoKeyEntryStruct
from pyproj import CRS, Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame

from ..reconstruct.model_files import read

MIDDLE = (84940.0, 447530.0)
LON, LAT = Transformer.from_crs(28992, 4326, always_xy=True).transform(*MIDDLE)
FRAME = SiteFrame(LAT, LON)
REGION = shapely.box(-40, -30, 40, 30)


def survey(path, crs=None, *, version="1.4", point_format=7, count=4000):
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.001] * 3, [84000, 447000, -5]
    if crs is not None:
        header.add_crs(CRS.from_user_input(crs))
    rng = np.random.default_rng(5)
    las = laspy.LasData(header)
    las.x, las.y = (m + rng.uniform(-150, 150, count) for m in MIDDLE)
    las.z = rng.uniform(-2, 9, count)
    las.classification = rng.choice([1, 2, 6], count).astype(np.uint8)
    las.number_of_returns = np.full(count, 2)
    las.return_number = rng.integers(1, 3, count)
    las.write(path)
    return laspy.read(path)


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_what_another_writer_wrote_around_the_region(tmp_path, name):
    las = survey(tmp_path / name, "EPSG:7415")
    model = read(tmp_path / name, FRAME, REGION)
    assert model.crs.is_compound
    assert model.up == "z"
    back = Transformer.from_crs(28992, 4326, always_xy=True)
    xy = FRAME.site_from_lonlat(np.column_stack(back.transform(las.x, las.y)))
    inside = (np.abs(xy) < [40, 30]).all(axis=1)
    found = model.cloud.points
    assert inside.sum() > 100
    kept = {tuple(p) for p in np.round(found, 3)}
    wanted = np.round(np.column_stack([las.x, las.y, las.z])[inside], 3)
    assert {tuple(p) for p in wanted} <= kept  # all of the region, and a margin
    assert len(found) < 0.25 * len(las)
    index = {tuple(p): k for k, p in enumerate(np.round(las.xyz, 3))}
    rows = [index[tuple(p)] for p in np.round(found, 3)]
    assert np.array_equal(model.cloud.classification, np.asarray(las.classification)[rows])
    assert np.array_equal(model.cloud.last, np.asarray(las.return_number)[rows] == 2)


def test_the_crs_of_site_yaml_crops_where_the_file_says_none(tmp_path):
    survey(tmp_path / "a.las")
    assert len(read(tmp_path / "a.las", FRAME, REGION).cloud.points) == 4000
    cropped = read(tmp_path / "a.las", FRAME, REGION, crs="EPSG:7415")
    assert 100 < len(cropped.cloud.points) < 1000
    assert cropped.crs is None  # the file itself says nothing


def test_the_vertical_system_of_geotiff_keys_is_not_lost(tmp_path):
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [84000, 447000, -5]
    keys = GeoKeyDirectoryVlr()
    keys.geo_keys = [
        GeoKeyEntryStruct(1024, 0, 1, 1),
        GeoKeyEntryStruct(3072, 0, 1, 28992),
        GeoKeyEntryStruct(4096, 0, 1, 5709),
    ]
    keys.geo_keys_header.number_of_keys = 3
    header.vlrs.append(keys)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.array([MIDDLE[0]]), np.array([MIDDLE[1]]), np.array([1.0])
    las.write(tmp_path / "a.las")
    crs = read(tmp_path / "a.las", FRAME, REGION).crs
    assert [part.to_epsg() for part in crs.sub_crs_list] == [28992, 5709]


@pytest.mark.thorough
def test_the_survey_of_delft(shared_data):
    folder = shared_data / "airborne" / "delft-ahn3" / "ahn3"
    model = read(folder, FRAME, REGION.buffer(500))
    assert len(model.cloud.points) == 640_510 + 208_432
    counts = np.bincount(model.cloud.classification, minlength=27)
    with (
        laspy.open(folder / "ahn3_cropped_1.laz") as one,
        laspy.open(folder / "ahn3_cropped_2.laz") as other,
    ):
        labels = [np.asarray(r.read().classification) for r in (one, other)]
    assert np.array_equal(counts, np.bincount(np.concatenate(labels), minlength=27))


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.5, 0.999])
def test_a_file_that_is_cut_short_is_told_in_a_line(tmp_path, name, share):
    survey(tmp_path / name, "EPSG:7415")
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError) as caught:
        read(tmp_path / name, FRAME, REGION)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_a_survey_of_another_place_is_told(tmp_path):
    survey(tmp_path / "a.las", "EPSG:7415")
    with pytest.raises(InputError, match="no point in the region"):
        read(tmp_path / "a.las", SiteFrame(48.1, 11.6), REGION)


def test_a_table_of_chunks_that_lies_is_refused_before_it_is_believed(tmp_path):
    """What once asked for 16 GB and ended the process: the counts and sizes of a LAZ."""
    path = tmp_path / "a.laz"
    survey(path, count=300)
    sound = path.read_bytes()
    first = int.from_bytes(sound[96:100], "little")
    table = int.from_bytes(sound[first : first + 8], "little")
    packed = sound.index(b"laszip encoded") - 2 + 54  # the record's content
    lies = {
        table + 4: b"\xff\xff\xff\xff",  # chunks
        table + 8: b"\xff\xff\xff\xff\xff\xff",  # their sizes
        packed + 12: b"\0\0\0\0",  # points of a chunk
        packed + 32: b"\xff\xff",  # fields of a point
        packed + 36: b"\xff\xff",  # bytes of one
        105: b"\xff\xff",  # bytes of a point
        247: b"\xff" * 8,  # points
        243: b"\xff" * 4,  # records behind the points
        100: b"\xff\xff\xff\xff",  # records before them
    }
    for place, lie in lies.items():
        path.write_bytes(sound[:place] + lie + sound[place + len(lie) :])
        tracemalloc.start()
        with pytest.raises(InputError, match=r"a\.laz: (cannot be read as LAS|is truncated)"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 1 << 28
        tracemalloc.stop()
