"""Models laid by control points, similarity or origin: against SciPy, PROJ and closed forms."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod
from scipy.spatial.transform import Rotation

from urbantwin.errors import InputError
from urbantwin.reconstruct.georeference.similarity import fitted, level_fitted

from .placing_site import FRAME, elevation, mesh_of, place, slope

POINTS = np.array([[0, 0, 0], [40, 5, 2], [-10, 35, 9], [25, -30, 4], [5, 12, 15.0]])
TURN = Rotation.from_euler("ZYX", [137, 4, -95], degrees=True)
SHIFT = np.array([12.0, -7.0, 3.0])


def on_site(points: np.ndarray, scale: float = 0.3048) -> np.ndarray:
    return scale * TURN.apply(points) + SHIFT


def entries(model: np.ndarray, site: np.ndarray) -> list[dict]:
    return [{"model": a.tolist(), "site_m": b.tolist()} for a, b in zip(model, site, strict=True)]


@pytest.mark.parametrize("seed", range(5))
def test_fitted_similarity_is_the_one_of_scipy(seed: int) -> None:
    random = np.random.default_rng(seed)
    a = random.normal(0, 20, (12, 3))
    b = 3.5 * Rotation.random(rng=seed).apply(a) + random.normal(0, 0.2, a.shape) + 1e5
    ours = fitted(a, b)
    theirs, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    assert np.allclose(ours.rotation, theirs.as_matrix(), atol=1e-9)
    # With the rotation known, the scale is a one-dimensional regression.
    p, q = theirs.apply(a - a.mean(axis=0)).ravel(), (b - b.mean(axis=0)).ravel()
    assert ours.scale == pytest.approx(p @ q / (p @ p), rel=1e-9)
    assert np.allclose((ours.apply(a) - b).mean(axis=0), 0, atol=1e-6)


def test_flat_points_are_not_mirrored() -> None:
    a = POINTS * [1, 1, 0]
    assert np.linalg.det(fitted(a, on_site(a)).rotation) == pytest.approx(1.0)
    assert np.allclose(fitted(a, on_site(a)).apply(a), on_site(a))


def test_level_fit_keeps_the_vertical() -> None:
    turn = Rotation.from_euler("z", 200, degrees=True)
    b = 2.0 * turn.apply(POINTS) + SHIFT
    out = level_fitted(POINTS[:2], b[:2])
    assert np.allclose(out.apply(POINTS), b)


def test_control_points_place_a_model_and_tell_residuals(tmp_path: Path) -> None:
    given = on_site(POINTS) + np.array([[0.02, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    out = place(tmp_path, mesh_of(POINTS), control_points=entries(POINTS, given))
    assert np.abs(out.model.mesh.vertices - on_site(POINTS)).max() < 0.02
    residuals = out.report["control_points"]
    assert residuals[0]["name"] == "control_points[0]"
    assert 0 < max(one["residual_m"] for one in residuals) < 0.02
    assert out.report["scale"] == pytest.approx(0.3048, rel=2e-3)


def test_control_points_of_a_file_by_latitude_and_longitude(tmp_path: Path) -> None:
    # x, y of the site by PROJ's geodesic, which is not the site's projection.
    site = on_site(POINTS)
    geod = Geod(ellps="WGS84")
    rows = ["name;model_x;model_y;model_z;latitude;longitude;height_m"]
    for number, (a, b) in enumerate(zip(POINTS, site, strict=True)):
        azimuth, distance = np.degrees(np.arctan2(b[0], b[1])), np.hypot(b[0], b[1])
        lon, lat, _ = geod.fwd(FRAME.longitude, FRAME.latitude, azimuth, distance)
        rows.append(f"p{number};{a[0]};{a[1]};{a[2]};{lat:.10f};{lon:.10f};{b[2]}")
    (tmp_path / "gcp.csv").write_text("\n".join(rows))
    out = place(tmp_path, mesh_of(POINTS), control_points="gcp.csv")
    assert np.abs(out.model.mesh.vertices - site).max() < 1e-3


def test_two_points_are_enough_where_up_is_known(tmp_path: Path) -> None:
    upright = Rotation.from_euler("x", 90, degrees=True).apply(POINTS)  # y-up to z-up
    site = 2.0 * Rotation.from_euler("z", 30, degrees=True).apply(upright) + SHIFT
    pair = entries(POINTS[:2], site[:2])
    out = place(tmp_path, mesh_of(POINTS), control_points=pair, up="y")
    assert np.abs(out.model.mesh.vertices - site).max() < 1e-9
    with pytest.raises(InputError, match=r"control points are 2; expected at least three"):
        place(tmp_path, mesh_of(POINTS), control_points=pair)


def test_points_without_a_height_lie_on_the_ground(tmp_path: Path) -> None:
    xy = np.array([[20.0, 10], [-30, 5], [0, 40], [10, -30]])
    model = np.column_stack([xy, slope(xy)])
    lonlat = FRAME.lonlat_from_site(xy)
    points = [
        {"model": a.tolist(), "latitude": float(b[1]), "longitude": float(b[0])}
        for a, b in zip(model, lonlat, strict=True)
    ]
    out = place(tmp_path, mesh_of(model), control_points=points, ground=elevation())
    assert np.abs(out.model.mesh.vertices - model).max() < 0.02
    assert any("laid on the ground" in one for one in out.report["problems"])


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda a, b: (a, b + np.eye(5)[[3]].T * [9, 0, 0]), r"control_points\[3\] is \d.* m off"),
        (lambda a, b: (a[:1], b[:1]), "is 1; expected at least three"),
        (lambda a, b: (a[:3] * [1, 0, 0], b[:3]), "lie on one line"),
        (lambda a, b: (a[[0, 1, 1, 2]], b[[0, 1, 1, 2]]), "are the same point in the model"),
        (lambda a, b: (a, b[[0, 1, 2, 3, 3]]), "are the same point on site"),
        (lambda a, b: (a[:4], b[[2, 0, 3, 1]]), "control points disagree|is .* m off"),
    ],
)
def test_bad_control_points_are_named(tmp_path: Path, change, line: str) -> None:
    a, b = change(POINTS, on_site(POINTS, 1.0))
    with pytest.raises(InputError, match=line) as error:
        place(tmp_path, mesh_of(POINTS), control_points=entries(a, b))
    assert "\n" not in str(error.value)
    assert "site.yaml: geometry[0].control_points" in str(error.value)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (None, r"gcp\.csv: not found"),
        ("a,b\n1,2\n", "has other columns; expected columns model_x"),
        ("model_x,model_y,model_z,x,y,z\n1,2,three,4,5,6\n", "point 1: model_z is 'three'"),
        ("model_x,model_y,model_z,x,y,z\n1,2,nan,4,5,6\n", "point 1: model_z is 'nan'"),
        ("model_x,model_y,model_z,x,y,z\n1,2,3,4,5\n", "point 1: z is None"),
        ("model_x,model_y,model_z,latitude,longitude\n1,2,3,95,5\n", "lies at 95, 5"),
        ("", "has other columns"),
    ],
)
def test_bad_files_of_control_points_are_named(tmp_path: Path, text, line: str) -> None:
    if text is not None:
        (tmp_path / "gcp.csv").write_text(text)
    with pytest.raises(InputError, match=line):
        place(tmp_path, mesh_of(POINTS), control_points="gcp.csv")


def test_similarity_is_scale_rotation_translation(tmp_path: Path) -> None:
    given = {
        "scale": 0.5,
        "yaw_deg": 30.0,
        "pitch_deg": -4.0,
        "roll_deg": 2.0,
        "translation_m": [1.0, 2.0, 3.0],
    }
    out = place(tmp_path, mesh_of(POINTS, up="z"), similarity=given)
    turn = Rotation.from_euler("ZYX", [30, -4, 2], degrees=True)
    assert np.allclose(out.model.mesh.vertices, 0.5 * turn.apply(POINTS) + [1, 2, 3])


def test_origin_with_heading_and_height(tmp_path: Path) -> None:
    # The model's own north looks east: its +y goes east, its +x goes south.
    lon, lat, _ = Geod(ellps="WGS84").fwd(FRAME.longitude, FRAME.latitude, 0.0, 25.0)
    given = {"latitude": lat, "longitude": lon, "heading_deg": 90.0, "height_m": 4.0}
    out = place(tmp_path, mesh_of(POINTS, up="z", unit_m=0.01), origin=given)
    want = np.column_stack([POINTS[:, 1], -POINTS[:, 0], POINTS[:, 2]]) * 0.01 + [0, 25, 4]
    assert np.abs(out.model.mesh.vertices - want).max() < 1e-4


def test_model_without_a_place_or_far_away_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"model\.obj does not say where it is; expected crs"):
        place(tmp_path, mesh_of(POINTS))
    far = {"latitude": -33.9, "longitude": 151.2}
    with pytest.raises(InputError, match=r"lies 16,\d\d\d km from the site's region"):
        place(tmp_path, mesh_of(POINTS, up="z", unit_m=1.0), origin=far)
    broken = POINTS.copy()
    broken[2, 1] = np.nan
    with pytest.raises(InputError, match="has 1 points that are not numbers"):
        place(tmp_path, mesh_of(broken), origin=far)
