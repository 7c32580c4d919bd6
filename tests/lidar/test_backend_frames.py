"""Frames of every backend are Embree's, but for which of two triangles in one place is met."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.lidar import Scanner
from urbantwin.lidar.casting.backend import tracer_on

from ..thorough import further

MILLIMETRE = 1e-3
EXACT = dict.fromkeys(
    ["noise", "dropout", "quantisation", "footprint", "glass", "retroreflection", "blooming"], False
)


@pytest.fixture(params=["warp:cpu", *further("bvh")])
def backend(request):
    """Return a backend that is compared with Embree."""
    if request.param.startswith("warp"):
        need_warp()
    return request.param


def need_warp():
    return pytest.importorskip("warp", reason="the extra 'warp' is not installed")


def by_beam(frame):
    """Return the points of a frame by sensor, ring, column and echo."""
    names = ("sensor", "ring", "column", "echo")
    keys = zip(*(getattr(frame, name).tolist() for name in names), strict=True)
    return {key: number for number, key in enumerate(keys)}


def frames(street, rig, actors, backend):
    """Return a frame of Embree's and the same of another backend."""
    return [Scanner(street, rig, 5, backend=name).scan(3, actors) for name in ("embree", backend)]


def moving(actors, seed=2):
    """Return actors that drive, each at its own speed."""
    rng = np.random.default_rng(seed)
    return [one._replace(velocity=np.array([*rng.uniform(-15, 15, 2), 0.0])) for one in actors]


@pytest.mark.parametrize(
    "sensor",
    [
        pytest.param({"effects": EXACT}, id="thin rays"),
        pytest.param({"returns": "dual"}, id="all effects, two returns"),
        *further({"model": "VLP-32C", "yaw_deg": 70.0, "pitch_deg": 12.0}),
    ],
)
def test_frames_are_the_same(street, rig_of, crowd, sensor, backend):
    rig = rig_of(
        street,
        {"columns": 512, "model": "OS1-128", **sensor}
        | ({"columns": None} if "model" in sensor else {}),
    )
    ours, other = frames(street, rig, moving(crowd(25, 3)), backend)
    mine, theirs = by_beam(ours), by_beam(other)
    assert len(mine) > 5000
    shared = sorted(set(mine) & set(theirs))
    # A material decides whether a weak return is noticed: of two triangles in one place, either.
    assert len(shared) >= 0.999 * max(len(mine), len(theirs))
    here, there = ([beams[key] for key in shared] for beams in (mine, theirs))
    apart = np.linalg.norm(ours.points[here, :3] - other.points[there, :3], axis=1)
    assert np.mean(apart <= MILLIMETRE) > 0.999
    assert np.mean(ours.instance[here] == other.instance[there]) > 0.999
    for a, b in zip(ours.boxes, other.boxes, strict=True):
        np.testing.assert_allclose(a.box, b.box, atol=1e-6)
        assert abs(a.num_points - b.num_points) <= 2 + 0.01 * a.num_points


def test_no_hit_of_a_whole_turn_differs(street, rig_of, crowd, backend):
    """With all effects off a point is where its ray hits: the same, to 1 mm, of every ray."""
    rig = rig_of(street, {"columns": 512, "effects": False})
    ours, other = frames(street, rig, crowd(25, 3), backend)
    assert by_beam(ours).keys() == by_beam(other).keys()
    apart = np.linalg.norm(ours.points[:, :3] - other.points[:, :3], axis=1)
    assert apart.max() <= MILLIMETRE
    np.testing.assert_array_equal(ours.instance, other.instance)
    np.testing.assert_array_equal(ours.semantic, other.semantic)


def test_a_sensor_that_sways_sees_the_same(street, rig_of, crowd, backend):
    """Nothing of the static world is kept: every ray is cast at it in every frame."""
    rig = rig_of(street, {"columns": 512, "effects": EXACT}, sway={"rms_m": 0.02})
    ours, other = frames(street, rig, moving(crowd(10, 4)), backend)
    mine, theirs = by_beam(ours), by_beam(other)
    shared = sorted(set(mine) & set(theirs))
    assert len(shared) >= 0.9999 * max(len(mine), len(theirs))
    here, there = ([beams[key] for key in shared] for beams in (mine, theirs))
    apart = np.linalg.norm(ours.points[here, :3] - other.points[there, :3], axis=1)
    assert np.mean(apart <= MILLIMETRE) > 0.9999


def test_frames_are_the_same_whatever_came_before(street, rig_of, crowd, backend):
    """Shapes that come later are sent to the device later, and nothing is left of a frame."""
    rig = rig_of(street, {"columns": 512})
    scanner = Scanner(street, rig, 1, backend=backend)
    scanner.scan(0, crowd(3, 1))
    scanner.scan(1, [])
    after = scanner.scan(2, moving(crowd(25, 9)))
    fresh = Scanner(street, rig, 1, backend=backend).scan(2, moving(crowd(25, 9)))
    np.testing.assert_array_equal(after.points, fresh.points)
    np.testing.assert_array_equal(after.instance, fresh.instance)
    np.testing.assert_array_equal(
        [one.box for one in after.boxes], [one.box for one in fresh.boxes]
    )


def test_threads_cast_side_by_side(street, rig_of, crowd, backend):
    """Turns of several threads are on the device at once; none sees what another sent."""
    rig = rig_of(street, {"columns": 512})
    scanner = Scanner(street, rig, 1, backend=backend)
    crowds = [moving(crowd(5 + 4 * number, number)) for number in range(4)]
    alone = [scanner.scan(number, one) for number, one in enumerate(crowds)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(scanner.scan, range(4), crowds))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.instance, other.instance)


@pytest.mark.parametrize(
    ("backend", "words"),
    [
        ("optix", "embree, bvh, warp or warp:DEVICE"),
        ("warp:", "embree, bvh, warp or warp:DEVICE"),
        ("warpcpu", "embree, bvh, warp or warp:DEVICE"),
        ("bvh:cpu", "embree, bvh, warp or warp:DEVICE"),
        ("", "embree, bvh, warp or warp:DEVICE"),
        ("warp:cuda:17", "no device 'cuda:17'; expected cpu"),
        ("warp:toaster", "no device 'toaster'; expected cpu"),
    ],
)
def test_backends_that_are_not_here(backend, words):
    if backend.startswith("warp:") and backend != "warp:":
        need_warp()
    with pytest.raises(InputError) as caught:
        tracer_on(backend)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.thorough
def test_kernels_compile_for_cuda(tmp_path):
    """NVIDIA's compiler comes with Warp and needs no GPU."""
    warp = need_warp()
    from urbantwin.lidar.casting.device import cast
    from urbantwin.lidar.casting.warp_shapes import warp_device

    warp_device("cpu")
    try:
        (made,) = warp.compile_aot_module(cast, arch=90, module_dir=tmp_path, use_ptx=True)
    except RuntimeError as error:
        pytest.skip(f"Warp cannot compile for CUDA here: {error}")
    for kernel in ("cast_axes", "find_layers"):
        assert f".entry {kernel}" in made.read_text()
