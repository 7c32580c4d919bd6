"""Models registered to the map: what was turned, scaled and shifted comes back; guesses do not."""

from pathlib import Path

import laspy
import numpy as np
import pyogrio.raw
import pytest
import shapely
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from urbantwin.drawing.geometry_pictures import registration_picture
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct import ImportedModel, PointCloud, Surroundings, TriangleMesh

from ..real_files import AHN3
from ..thorough import further
from .placing_site import (
    FRAME,
    elevation,
    place,
    surroundings,
    town,
    town_mesh,
)

HOUSES = town()
MESH = town_mesh(HOUSES)
Y_UP = Rotation.from_euler("x", -90, degrees=True)


def disguised(turn: Rotation, *, scale: float = 1.0, noise: float = 0.03, shift=(12, -5, 40)):
    """The town as somebody's photogrammetry: turned, scaled, shifted, with noise."""
    random = np.random.default_rng(1)
    points = MESH.vertices + random.normal(0, noise, MESH.vertices.shape)
    return ImportedModel(mesh=TriangleMesh.build(scale * (turn.apply(points) + shift), MESH.faces))


def errors(model: ImportedModel) -> tuple[float, float]:
    """How far a placed town is off: the worst of its vertices in metres, and its heading."""
    off = model.mesh.vertices - MESH.vertices
    a, b = ((v - v.mean(axis=0))[:, :2] @ [1, 1j] for v in (model.mesh.vertices, MESH.vertices))
    return float(np.abs(off).max()), float(abs(np.degrees(np.angle(np.vdot(b, a)))))


@pytest.mark.parametrize(
    ("turn", "scale", "spec"),
    [
        (Y_UP * Rotation.from_euler("z", 137, degrees=True), 1.0, {"register": True}),
        *further(
            (
                Y_UP * Rotation.from_euler("z", 137, degrees=True),
                0.01,
                {"register": {"scale": True}},
            )
        ),
    ],
    ids=["y-up", "unknown scale"],
)
def test_disguised_town_comes_back(tmp_path: Path, turn, scale: float, spec: dict) -> None:
    out = place(
        tmp_path,
        disguised(turn, scale=scale),
        around=surroundings(HOUSES),
        ground=elevation(),
        **spec,
    )
    off, heading = errors(out.model)
    assert off < 0.2
    assert heading < 0.1
    report = out.report["registration"]
    assert report["outlines"]["median_m"] < 0.1
    assert report["ground"]["median_m"] < 0.1
    assert report["confidence"] > 0.3


@pytest.mark.thorough
def test_town_that_leans_or_stands_on_its_head_is_set_upright(tmp_path: Path) -> None:
    lean = Rotation.from_euler("zx", [200, 165], degrees=True)
    out = place(
        tmp_path,
        disguised(lean, scale=100.0),
        around=surroundings(HOUSES),
        ground=elevation(),
        unit="cm",
        register=True,
    )
    assert errors(out.model)[0] < 0.25
    assert out.report["registration"]["turned_over"]


@pytest.mark.thorough
def test_registration_refines_a_rough_origin_and_repeats_itself(tmp_path: Path) -> None:
    rough = {"latitude": FRAME.latitude, "longitude": FRAME.longitude, "heading_deg": 0.0}
    model = disguised(Rotation.from_euler("z", 3, degrees=True), shift=(4, -6, 0))
    runs = [
        place(
            tmp_path,
            model,
            around=surroundings(HOUSES),
            ground=elevation(),
            origin=rough,
            register={"search_m": 8.0, "search_deg": 4.0},
            up="z",
            unit="m",
        )
        for _ in range(2)
    ]
    assert errors(runs[0].model)[0] < 0.2
    assert runs[0].model.mesh.vertices.tobytes() == runs[1].model.mesh.vertices.tobytes()
    pictures = [
        registration_picture(run.registration, surroundings(HOUSES), tmp_path / f"{number}.png")
        for number, run in enumerate(runs)
    ]
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_sloppy_map_is_enough(tmp_path: Path) -> None:
    # A third of the houses is not mapped, the others are a metre off.
    random = np.random.default_rng(7)
    mapped = tuple(
        shapely.affinity.translate(house, *random.normal(0, 0.7, 2))
        for house in HOUSES
        if random.random() > 0.33
    )
    turn = Rotation.from_euler("z", 80, degrees=True)
    out = place(tmp_path, disguised(turn), around=surroundings(mapped), up="z", register=True)
    off = out.model.mesh.vertices[:, :2] - MESH.vertices[:, :2]
    assert np.abs(off).max() < 1.5


@pytest.mark.thorough
def test_guesses_are_refused(tmp_path: Path) -> None:
    model = disguised(Rotation.from_euler("z", 80, degrees=True))

    def refused(line: str, around: Surroundings, **spec) -> None:
        with pytest.raises(InputError, match=line) as error:
            place(tmp_path, model, around=around, up="z", unit="m", **spec)
        assert "site.yaml: geometry[0].register" in str(error.value)

    refused("no building and no road", surroundings((), shapely.Polygon()), register=True)
    refused("look like the map|two ways|residual", surroundings(town(seed=99)), register=True)
    quarters = tuple(shapely.box(x, y, x + 20, y + 20) for x in (-50, 30) for y in (-50, 30))
    cross = shapely.union_all([shapely.box(-90, -5, 90, 5), shapely.box(-5, -90, 5, 90)])
    model = ImportedModel(mesh=town_mesh(quarters))
    refused("in two ways that are nearly as good", surroundings(quarters, cross), register=True)
    model = ImportedModel(mesh=MESH)
    strict = {"worst_residual_m": 1e-4, "search_m": 3.0, "search_deg": 3.0}
    here = {"latitude": FRAME.latitude, "longitude": FRAME.longitude, "heading_deg": 0.0}
    said = "residual of .* to the outlines"
    refused(said, surroundings(HOUSES), origin=here, register=strict)


@pytest.mark.thorough
def test_survey_of_delft_finds_its_footprints(shared_data: Path, tmp_path: Path) -> None:
    # A real survey without a place or a heading, and footprints that others drew.
    folder = shared_data / "airborne/delft-ahn3"
    frame = SiteFrame(52.0117046, 4.3667012)
    to_lonlat = Transformer.from_crs("EPSG:28992", "EPSG:4326", always_xy=True)

    def on_site(xy: np.ndarray) -> np.ndarray:
        return frame.site_from_lonlat(np.column_stack(to_lonlat.transform(*xy.T)))

    def shapes(name: str) -> list[shapely.Geometry]:
        _, _, wkb, _ = pyogrio.raw.read(folder / "bgt" / name)
        valid = [shapely.make_valid(shapely.force_2d(shapely.from_wkb(one))) for one in wkb]
        return [shapely.transform(one, on_site) for one in valid]

    houses = [part for one in shapes("bgt_pand.sqlite") for part in shapely.get_parts(one)]
    around = Surroundings(
        shapely.Point(0, 0).buffer(110),
        shapely.union_all(shapes("bgt_wegdeel.sqlite")),
        tuple(house for house in houses if house.geom_type == "Polygon"),
        np.zeros((0, 3)),
    )
    points = np.vstack([np.asarray(laspy.read(f).xyz) for f in (folder / name for name in AHN3)])
    points = points[::3]
    truth = on_site(points[:, :2])
    turn = Rotation.from_euler("z", -64, degrees=True)
    local = turn.apply(points - points.mean(axis=0)) + [3, 4, 5]
    model = ImportedModel(cloud=PointCloud(local))
    out = place(tmp_path, model, frame=frame, around=around, up="z", unit="m", register=True)
    off = np.hypot(*(out.model.cloud.points[:, :2] - truth).T)
    assert np.quantile(off, 0.95) < 0.3
    assert out.report["registration"]["confidence"] > 0.3
