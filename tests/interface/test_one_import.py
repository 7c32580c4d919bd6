"""What is loaded for what, and what a type checker and a completer know of it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import urbantwin as ut
from urbantwin.cli.commands import GROUPS

from ..reliability.small_site import ROOT
from .conftest import Line

HEAVY = (
    "numpy numba scipy shapely pyproj rasterio osmium sumolib libsumo embreex lxml matplotlib "
    "pyarrow laspy optuna"
).split()


def loaded(program: str, *arguments: object) -> set[str]:
    """The heavy modules that a program has loaded in a process of its own."""
    told = f"\nimport sys\nprint([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program + told, *map(str, arguments)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return set(eval(done.stdout.splitlines()[-1]))


def test_the_import_alone_loads_nothing() -> None:
    assert loaded("import urbantwin as ut; ut.__version__; dir(ut)") == set()


def test_a_dataset_is_read_with_numpy_alone(line: Line) -> None:
    program = (
        "import sys, urbantwin as ut\n"
        "frame = ut.open(sys.argv[1])[3]\n"
        "assert len(frame.points) == len(frame.semantic)"
        " == len(frame.instance) == len(frame.rays)\n"
        "assert not {'pyarrow', 'numba', 'scipy'} & set(sys.modules)\n"
        "assert frame.boxes.num_rows >= 0"
    )
    assert loaded(program, line.dataset.folder) == {"numpy", "pyarrow"}


def test_a_motion_is_read_without_what_made_it(line: Line) -> None:
    program = "import sys, urbantwin as ut; assert ut.open(sys.argv[1]).actors.num_rows"
    assert not loaded(program, line.motion.folder) & {
        "numba", "rasterio", "osmium", "sumolib", "libsumo", "embreex", "pyproj", "matplotlib"
    }  # fmt: skip


@pytest.mark.thorough
def test_two_folders_of_clouds_are_compared_without_what_makes_twins(
    line: Line, tmp_path: Path
) -> None:
    for side, numbers in (("real", (0, 1)), ("synthetic", (2, 3))):
        (tmp_path / side).mkdir()
        for number in numbers:
            np.save(tmp_path / side / f"{number}.npy", line.dataset[number].points[::50])
    program = (
        "import sys, urbantwin as ut\n"
        "ut.compare(*sys.argv[1:], arbitrary='none', workers=1, progress=False)"
    )
    folders = [tmp_path / name for name in ("real", "synthetic", "report")]
    # numba finds the nearest points and triangles, matplotlib draws the report.
    assert loaded(program, *folders) == {"numpy", "numba", "scipy", "matplotlib"}


def test_a_measure_loads_what_it_computes_with() -> None:
    for measure, needed in (
        ("jensen_shannon", {"numpy"}),
        ("earth_mover", {"numba", "numpy", "scipy"}),  # beside measures of nearest points
    ):
        program = f"from urbantwin.fidelity import {measure}; {measure}.__doc__"
        assert loaded(program) <= needed


def test_every_public_name_is_there_for_completion() -> None:
    assert set(ut.__all__) <= set(dir(ut))
    for name in ut.__all__:
        assert getattr(ut, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'biuld'"):
        _ = ut.biuld


def test_a_module_of_the_same_name_hides_no_function() -> None:
    program = (
        "import urbantwin.fidelity.compare, urbantwin.fidelity.cloud_distances\n"
        "from urbantwin.fidelity import chamfer, compare\n"
        "assert callable(chamfer) and callable(compare)"
    )
    loaded(program)


def test_no_function_has_the_name_of_a_package() -> None:
    packages = {path.stem for path in (ROOT / "src" / "urbantwin").glob("*.py")}
    packages |= {path.parent.name for path in (ROOT / "src" / "urbantwin").glob("*/__init__.py")}
    assert packages & set(ut.__all__) == set(GROUPS)


def test_a_strict_type_checker_knows_the_types_of_a_script(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import urbantwin as ut\n"
        "twin = ut.build('site.yaml', pictures=False)\n"
        "motion = ut.drive(twin, seconds=60)\n"
        "dataset = ut.record(twin, motion, rig='rig.yaml')\n"
        "reveal_type(dataset[3].points)\n"
        "reveal_type(twin.mesh.vertices)\n"
        "reveal_type(twin.plot())\n"
        "reveal_type(ut.compare('real/', dataset).figures('chamfer_m'))\n"
        "reveal_type(ut.catalogue.sensors('OS1-128'))\n"
        "for frame in ut.open('out/dataset'): print(frame.points)\n"
        "ut.drive(twin, second=60)\n"
        "ut.biuld('site.yaml')\n"
    )
    # With the project's settings (strict) and cache: ``make test`` has just checked the sources.
    done = subprocess.run(
        [sys.executable, "-m", "mypy", script],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    revealed = [line.split('"')[1] for line in lines if "Revealed type" in line]
    assert "ndarray" in revealed[0]
    assert "_32Bit" in revealed[0]
    assert "float64" in revealed[1]
    assert revealed[2] == "matplotlib.figure.Figure"
    assert "float64" in revealed[3]
    assert revealed[4].endswith("Datasheet")
    errors = [line.split(": error: ")[1] for line in lines if ": error: " in line]
    assert len(errors) == 2, done.stdout
    assert "second" in errors[0]
    assert "biuld" in errors[1]
