"""Models in a reference system: against published coordinates, closed forms and real surveys."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS, Geod, Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.io.model import Geotag
from urbantwin.reconstruct import ImportedModel, PointCloud
from urbantwin.reconstruct.georeference import SiteHeights
from urbantwin.reconstruct.georeference.height_system import (
    HeightSystem,
    NoGridError,
    geoid_height,
    heights_between,
)

from ..real_files import AHN3
from .placing_site import FRAME, elevation, ground_mesh, mesh_of, place, slope, surroundings

TO_RD = Transformer.from_crs("EPSG:4326", "EPSG:28992", always_xy=True)
NAP, ELLIPSOIDAL = CRS("EPSG:5709"), CRS("EPSG:4979")


def in_rd(points: np.ndarray) -> np.ndarray:
    """Site metres as Dutch national coordinates, by way of the geodesic; heights kept."""
    azimuth = np.degrees(np.arctan2(points[:, 0], points[:, 1]))
    start = np.full(len(points), FRAME.longitude), np.full(len(points), FRAME.latitude)
    lon, lat, _ = Geod(ellps="WGS84").fwd(*start, azimuth, np.hypot(*points[:, :2].T))
    return np.column_stack([*TO_RD.transform(lon, lat), points[:, 2]])


def ground(offset: float, crs: str | None) -> ImportedModel:
    """The site's ground as a model, its heights raised."""
    mesh = ground_mesh()
    raised = in_rd(mesh.vertices) + [0, 0, offset]
    model = mesh_of(raised, crs=CRS(crs) if crs else None, up="z")
    return ImportedModel(
        mesh=type(mesh).build(model.mesh.vertices, mesh.faces), crs=model.crs, up="z"
    )


def dem(height: float, datum: CRS | None) -> dict:
    """What placing is told of a DEM whose anchor lies at a height."""
    system = HeightSystem.of(datum)
    return {"ground": elevation(), "heights": SiteHeights(height, system, "dem.tif")}


def test_tower_of_amersfoort_is_where_it_is_published(tmp_path: Path) -> None:
    # The origin of the Dutch grid, RD 155000, 463000, in ETRS89 (RDNAPTRANS, Kadaster).
    frame = SiteFrame(52.155172897, 5.387203657)
    corners = np.array([[0, 0, 0], [30, 0, 0], [30, 30, 0], [0, 30, 0.0]])
    model = mesh_of(corners + [155_000, 463_000, 0], crs=CRS("EPSG:28992"), up="z")
    out = place(tmp_path, model, frame=frame)
    # The transformation without its grid is good to a quarter of a metre; north is not quite up.
    assert np.abs(out.model.mesh.vertices - corners).max() < 0.4
    assert out.report["accuracy_m"] == 1.0
    assert "Amersfoort to WGS 84" in out.report["transformation"]


def test_geocentric_points_stand_on_the_ellipsoid(tmp_path: Path) -> None:
    # Closed formula of ECEF from east, north, up (Torge, Geodesy, 4.1.3).
    lat, lon, h = np.radians(FRAME.latitude), np.radians(FRAME.longitude), 45.0
    a, e2 = 6378137.0, 0.00669437999014
    n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    origin = (np.array([n, n, n * (1 - e2)]) + h) * up
    enu = np.array([[0, 0, 0], [60, 0, 0], [0, 60, 10], [-60, -60, 0.0]])
    points = origin + enu @ np.vstack([east, np.cross(up, east), up])
    model = mesh_of(points, crs=CRS("EPSG:4978"))
    heights = SiteHeights(h, HeightSystem.of(ELLIPSOIDAL), "dem.tif")
    out = place(tmp_path, model, heights=heights)
    # A tangent plane is 0.6 mm above the ellipsoid at 85 m.
    assert np.abs(out.model.mesh.vertices - enu).max() < 1e-3


def test_feet_of_a_state_plane_are_feet(tmp_path: Path) -> None:
    frame = SiteFrame(40.7061, -74.0087)
    feet = 1200 / 3937
    to_plane = Transformer.from_crs("EPSG:4326", "EPSG:2263", always_xy=True)
    lon, lat, _ = Geod(ellps="WGS84").fwd(frame.longitude, frame.latitude, 90.0, 50.0)
    x, y = to_plane.transform([frame.longitude, lon, lon], [frame.latitude, lat, frame.latitude])
    points = np.column_stack([x, y, np.array([10.0, 20.0, 30.0]) / feet])
    model = mesh_of(points, crs=CRS("EPSG:2263+6360"), up="z")
    heights = SiteHeights(4.0, HeightSystem.of(CRS("EPSG:5703")), "dem.tif")  # the same in metres
    got = place(tmp_path, model, heights=heights, frame=frame).model.mesh.vertices
    assert np.allclose(got[:, 2], [6, 16, 26], atol=1e-6)
    assert np.allclose(got[1, :2], [50, 0], atol=0.02)


def test_first_source_says_what_zero_is_and_the_next_obeys(tmp_path: Path) -> None:
    first = place(tmp_path, ground(12.34, "EPSG:7415"))
    assert first.heights.anchor_m == pytest.approx(12.34, abs=0.02)
    assert first.heights.datum.name == "NAP height"
    want = slope(first.model.mesh.vertices[:, :2])
    assert np.abs(first.model.mesh.vertices[:, 2] - want).max() < 0.03
    # Far from the anchor, and a metre off its own ground: only the datum can tell.
    far = in_rd(np.array([[60, 60, 30], [70, 60, 30], [70, 70, 31.0]]))
    model = mesh_of(far, crs=CRS("EPSG:7415"), up="z")
    out = place(tmp_path, model, heights=first.heights, ground=None)
    assert np.allclose(out.model.mesh.vertices[:, 2], far[:, 2] - first.heights.anchor_m)


@pytest.mark.parametrize(
    ("crs", "datum"), [("EPSG:7415", NAP), ("EPSG:7415", None), ("EPSG:28992", NAP)]
)
def test_heights_that_agree_are_taken(tmp_path: Path, crs: str, datum: CRS | None) -> None:
    out = place(tmp_path, ground(7.0, crs), **dem(7.0, datum))
    vertices = out.model.mesh.vertices
    assert np.abs(vertices[:, 2] - slope(vertices[:, :2])).max() < 1e-3
    assert abs(out.report["heights"]["ground_above_site_m"]) < 0.1


@pytest.mark.parametrize(
    ("offset", "crs", "datum", "line"),
    [
        # The geoid is 43.5 m above the ellipsoid here.
        (50.5, "EPSG:28992", NAP, r"ground 43\.\d m above that of dem\.tif: .* ellipsoidal"),
        (50.5, "EPSG:7415", NAP, r"ellipsoidal heights, although NAP height is stated"),
        (-36.5, "EPSG:7415", None, r"below that of dem\.tif: looks as if dem\.tif has ellips"),
        (10.0, "EPSG:28992", None, r"ground 3\.0 m above that of dem\.tif; expected heights of"),
        (7.0, "EPSG:7415", ELLIPSOIDAL, r"nl_nsgi_nlgeo2018\.tif is not installed; expected the"),
    ],
)
def test_heights_are_never_silently_wrong_by_a_geoid(
    tmp_path: Path, offset: float, crs: str, datum: CRS | None, line: str
) -> None:
    with pytest.raises(InputError, match=line) as error:
        place(tmp_path, ground(offset, crs), **dem(7.0, datum))
    assert "\n" not in str(error.value)


def test_offset_is_a_way_out_and_is_checked(tmp_path: Path) -> None:
    model, told = ground(7.0, "EPSG:7415"), dem(50.5, ELLIPSOIDAL)
    out = place(tmp_path, model, height_offset_m=43.5, **told)
    vertices = out.model.mesh.vertices
    assert np.abs(vertices[:, 2] - slope(vertices[:, :2])).max() < 1e-3
    assert not out.model.problems
    wrong = place(tmp_path, model, height_offset_m=40.0, **told)
    assert any("3.5 m below that of dem.tif" in one for one in wrong.model.problems)


def test_geoid_is_the_published_one() -> None:
    # NGA's sample points of EGM96 (OUTPUT.DAT of its program F477); 15' bilinear is coarser.
    places = np.array([[269.779155 - 360, 38.628155], [305.021114 - 360, -14.621217]])
    assert np.allclose(geoid_height(places), [-31.628, -2.969], atol=0.3)
    egm, ellipsoid = (HeightSystem.of(CRS(one)) for one in ("EPSG:5773", "EPSG:4979"))
    there, how = heights_between(places, np.zeros(2), egm, ellipsoid)
    back, _ = heights_between(places, there, ellipsoid, egm)
    assert np.allclose(there, geoid_height(places))
    assert np.allclose(back, 0)
    assert "EGM96" in how


def test_no_ballpark_between_datums_of_heights() -> None:
    navd, ellipsoid = (HeightSystem.of(CRS(one)) for one in ("EPSG:5703", "EPSG:6319"))
    with pytest.raises(NoGridError, match=r"us_noaa_\w+\.tif"):
        heights_between(np.array([[-80.0, 40.0]]), np.zeros(1), navd, ellipsoid)


@pytest.mark.parametrize(
    ("spec", "line"),
    [
        ({"crs": "EPSG:999999"}, r"geometry\[0\]\.crs \(line 2\): .* PROJ does not know"),
        ({"crs": 'LOCAL_CS["pit",UNIT["metre",1]]'}, "has the engineering CRS 'pit'"),
        ({"crs": "EPSG:5709"}, "has the vertical CRS 'NAP height'"),
        ({"crs": "EPSG:32633"}, r"lies \d,\d\d\d km from the site's region .* 'WGS 84 / UTM zone"),
        ({"crs": "EPSG:32017"}, r"lies \d,\d\d\d km from the site's region .* 'NAD27"),
        ({"crs": "EPSG:4326"}, r"has 100% of its points where its CRS 'WGS 84' does not hold"),
    ],
)
def test_crs_that_leads_nowhere_is_named(tmp_path: Path, spec: dict, line: str) -> None:
    with pytest.raises(InputError, match=line):
        place(tmp_path, ground(0.0, None), **spec)


def test_crs_of_the_site_file_goes_before_the_files_own(tmp_path: Path) -> None:
    out = place(tmp_path, ground(5.0, "EPSG:32633"), crs="EPSG:7415")
    assert out.report["crs"] == "Amersfoort / RD New + NAP height (EPSG:7415)"
    assert any("was set aside" in one for one in out.model.problems)


def test_y_up_model_in_a_crs_is_turned(tmp_path: Path) -> None:
    model = ground(5.0, "EPSG:7415")
    x, y, z = model.mesh.vertices.T
    turned = mesh_of(np.column_stack([x, z, -y]), crs=model.crs)
    out = place(tmp_path, turned)
    assert out.report["up"] == "y"
    assert "far away" in out.report["up_why"]
    assert np.abs(out.model.mesh.vertices[:, :2]).max() < 101


def test_geotag_whose_height_is_of_no_known_datum_is_laid_on_the_ground(tmp_path: Path) -> None:
    mesh = ground_mesh()
    model = ImportedModel(
        mesh=type(mesh).build(mesh.vertices + [0, 0, 3.0], mesh.faces),
        up="z",
        unit_m=1.0,
        geotag=Geotag(FRAME.latitude, FRAME.longitude, 88.0, 0.0, ""),
    )
    out = place(tmp_path, model, **dem(7.0, NAP))
    assert np.abs(out.model.mesh.vertices - mesh.vertices).max() < 0.1
    assert any("height of its geotag was not used" in one for one in out.model.problems)


@pytest.mark.thorough
def test_survey_of_delft_lies_where_its_reference_lies(shared_data: Path, tmp_path: Path) -> None:
    file = shared_data / "airborne/delft-ahn3" / AHN3[0]
    survey = laspy.read(file)
    cloud = PointCloud(
        np.asarray(survey.xyz, float), classification=np.array(survey.classification)
    )
    frame = SiteFrame(52.0117, 4.3662)
    around = surroundings()
    out = place(
        tmp_path, ImportedModel(cloud=cloud, crs=CRS("EPSG:7415")), frame=frame, around=around
    )
    points, is_ground = out.model.cloud.points, cloud.classification == 2
    near = is_ground & (np.hypot(*points[:, :2].T) < 6)
    # z is the height above the ground at the anchor, and NAP is kept to the millimetre.
    assert abs(np.median(points[near, 2])) < 0.15
    assert np.allclose(points[:, 2] + out.heights.anchor_m, cloud.points[:, 2], atol=1e-6)
    # Distances are the ground's: the Dutch grid's scale is 0.9999 there.
    pair = [0, len(points) // 2]
    own = np.hypot(*np.diff(points[pair, :2], axis=0)[0])
    grid = np.hypot(*np.diff(cloud.points[pair, :2], axis=0)[0])
    assert own / grid == pytest.approx(1.00006, abs=3e-5)
