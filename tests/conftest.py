"""Fixtures shared by every test."""

import fcntl
import gc
import json
import math
import os
import pickle
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

if TYPE_CHECKING:
    from urbantwin.twin import Twin

ROOT = Path(__file__).parents[1]
SHARED_DATA = ROOT.parent / "shared" / "data"
#: Judges without a wheel from this Python on (requirements-judges.in).
JUDGES_END = {"av2": (3, 13), "carla": (3, 13), "pyclothoids": (3, 12)}
JUDGES = Path(os.environ.get("URBANTWIN_JUDGES", ROOT / ".venv-judges" / "bin" / "python"))

# Hundreds of processes import the same modules: Python compiles them once, whatever it was told.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Not what the person who runs the tests has allowed.
os.environ["XDG_CONFIG_HOME"] = str(ROOT / "tests" / "no-configuration")

# The same examples in every run; HYPOTHESIS_PROFILE=default looks for new ones.
# How slowly they are drawn, and run, tells of what else the machine does.
settings.register_profile(
    "seeded",
    max_examples=50,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "seeded"))
# It would try the numbers in the code of all modules that are imported so far, which takes
# seconds to read, and makes the examples depend on which tests ran before.
providers._get_local_constants = lambda: providers._local_constants


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what reads real inputs."""
    for item in items:
        if "shared_data" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.real)


# Nothing of what is imported and collected is garbage.
gc.disable()


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Take what stays until the end out of every later search for garbage.

    Modules and 8,000 tests are a million objects, which each full search goes through.
    """
    gc.set_threshold(7_000, 10, 10)  # as the program does
    gc.enable()
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def heard() -> None:
    """Let programs hear signals that a shell in the background has them ignore."""
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:  # exec turns any handler into the default
            signal.signal(number, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real inputs, which stands beside the checkout."""
    if not SHARED_DATA.is_dir():
        if os.environ.get("CI"):
            pytest.fail(f"{SHARED_DATA} is missing")
        pytest.skip(f"real inputs are not here ({SHARED_DATA})")
    return SHARED_DATA


@pytest.fixture(scope="session")
def judge() -> Callable[..., Any]:
    """Return ``judge(script, *arguments, job=None)``: what a script of ``tests/judges`` answers.

    It runs in the judges' own Python, and gets a job, if any, as JSON on its standard input.
    """
    if not JUDGES.exists():
        if os.environ.get("CI"):
            pytest.fail(f"{JUDGES} is missing: make judges")
        pytest.skip("the judges of exported files are not installed (make judges)")

    def answer(script: str, *arguments: Path | str, job: object = None) -> Any:
        done = subprocess.run(
            [JUDGES, ROOT / "tests" / "judges" / f"{script}.py", *arguments],
            input=json.dumps(job), capture_output=True, text=True, check=False,
        )  # fmt: skip
        for module, version in JUDGES_END.items():
            if sys.version_info >= version and f"No module named '{module}'" in done.stderr:
                pytest.skip(f"{module} has no wheel for Python 3.{sys.version_info[1]}")
        assert done.returncode == 0, done.stderr[-2000:]
        return json.loads(done.stdout.splitlines()[-1])

    return answer


@pytest.fixture(scope="session")
def chromium() -> Path:
    """Return the path of a browser that starts; `make test` installs one where that can be done."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name)
        if (
            path
            and not subprocess.run([path, "--version"], capture_output=True, check=False).returncode
        ):
            return Path(path)
    pytest.skip("no Chromium here; on Debian: apt-get install chromium")


def _changes(folder: Path) -> dict[Path, tuple[int, int]]:
    """Return the size of every file of a folder and when it was last written."""
    return {
        path: (path.stat().st_size, path.stat().st_mtime_ns)
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="session")
def made_once(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Callable[[str, Callable[[Path], object]], Path]]:
    """Return what makes a folder once in a run of the tests, for all workers of it.

    ``made_once(name, make)`` calls ``make(folder)`` unless a worker did; the others wait for it.
    What is made is left as it is: a test that changes something copies it first.
    """
    base = tmp_path_factory.getbasetemp()
    place = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "made-once"
    place.mkdir(exist_ok=True)
    used: dict[Path, dict[Path, tuple[int, int]]] = {}

    def made(name: str, make: Callable[[Path], object]) -> Path:
        folder = place / name
        with (place / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.exists():
                scratch = place / f"{name}.new"
                shutil.rmtree(scratch, ignore_errors=True)  # of a worker that failed
                scratch.mkdir()
                make(scratch)
                scratch.rename(folder)
        used.setdefault(folder, _changes(folder))
        return folder

    yield made
    for folder, before in used.items():
        assert _changes(folder) == before, f"a test changed {folder}"


@pytest.fixture(scope="session")
def built_page() -> None:
    """The page's bundle, which `make web` builds."""
    if not (ROOT / "src" / "urbantwin" / "web" / "page" / "page.js").is_file():
        if os.environ.get("CI"):
            pytest.fail("the page is not built: make web")
        pytest.skip("the page is not built (make web)")


@pytest.fixture(scope="session")
def two_avenues_twin(made_once: Callable[[str, Callable[[Path], object]], Path]) -> "Twin":
    """Return the twin of the example, which is made once; beside it lies what its build told."""
    from urbantwin.site import load_site
    from urbantwin.twin import build_twin, load_twin

    def make(folder: Path) -> None:
        site, told = load_site(ROOT / "examples" / "two-avenues" / "site.yaml"), []
        build_twin(site, folder / "twin", lambda share, doing: told.append((share, doing)))
        (folder / "told.json").write_text(json.dumps(told))

    return load_twin(made_once("two-avenues", make) / "twin")


@pytest.fixture(scope="session")
def open_avenues_twin(made_once: Callable[[str, Callable[[Path], object]], Path]) -> "Twin":
    """Return the twin of the example whose streets are not closed to a loop."""
    from urbantwin.site import load_site
    from urbantwin.twin import build_twin, load_twin

    def make(folder: Path) -> None:
        shutil.copytree(ROOT / "examples" / "two-avenues", folder, dirs_exist_ok=True)
        site = folder / "site.yaml"
        site.write_text(f"{site.read_text()}\nclosed_loop: false\n")
        build_twin(load_site(site), folder / "twin")

    return load_twin(made_once("open-avenues", make) / "twin")


@pytest.fixture(scope="session")
def planned_once(
    made_once: Callable[[str, Callable[[Path], object]], Path],
) -> Iterator[Callable[..., Any]]:
    """Plan a twin's traffic once for all exports: that takes seconds."""
    from urbantwin.traffic.demand.site_demand import demand_of

    known: dict[str, Any] = {}

    def planned(twin: "Twin", *, duration_s: float, seed: int, metered: bool = True) -> Any:
        def make(folder: Path) -> None:
            found = demand_of(twin, duration_s=duration_s, seed=seed, metered=metered)
            (folder / "demand.pickle").write_bytes(pickle.dumps(found))

        key = f"demand-{twin.sha256}-{duration_s}-{seed}-{metered}"
        if key not in known:
            known[key] = pickle.loads((made_once(key, make) / "demand.pickle").read_bytes())
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        for module in ("sumo", "carla.package"):
            patch.setattr(f"urbantwin.exports.{module}.demand_of", planned)
        yield planned


@pytest.fixture
def write_osm(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes OSM XML: nodes {id: (x, y, tags)}, ways {id: (nodes, tags)},
    relations {id: ([(type, member, role)], tags)}.

    x, y are metres around 48.7 N 9.18 E, on a sphere's tangent plane: good to a few centimetres
    within 300 m.
    """

    def write(
        nodes: dict, ways: dict, name: str = "map.osm", relations: dict | None = None
    ) -> Path:
        root = ElementTree.Element("osm", version="0.6")
        north = 111_194.9
        for identity, (x, y, tags) in nodes.items():
            lat, lon = 48.7 + y / north, 9.18 + x / (north * math.cos(math.radians(48.7)))
            node = ElementTree.SubElement(
                root, "node", id=str(identity), lat=f"{lat:.9f}", lon=f"{lon:.9f}", version="1"
            )
            for key, value in tags.items():
                ElementTree.SubElement(node, "tag", k=key, v=value)
        for identity, (refs, tags) in ways.items():
            way = ElementTree.SubElement(root, "way", id=str(identity), version="1")
            for ref in refs:
                ElementTree.SubElement(way, "nd", ref=str(ref))
            for key, value in tags.items():
                ElementTree.SubElement(way, "tag", k=key, v=value)
        for identity, (members, tags) in (relations or {}).items():
            relation = ElementTree.SubElement(root, "relation", id=str(identity), version="1")
            for kind, ref, role in members:
                ElementTree.SubElement(relation, "member", type=kind, ref=str(ref), role=role)
            for key, value in tags.items():
                ElementTree.SubElement(relation, "tag", k=key, v=value)
        path = tmp_path / name
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
        return path

    return write
