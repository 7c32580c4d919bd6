"""One rule for outputs that are single files: what is not ours, or no file, is not replaced."""

import ast
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from urbantwin.cli import main
from urbantwin.exports import FORMATS

from ..source_imports import MODULES
from ..thorough import further
from .conftest import Line

Command = Callable[[Line, Path], list[object]]


def export(of: str, to: str) -> Command:
    return lambda line, out: ["export", getattr(line, of).folder, "--to", to, "-o", out]


#: The output's name, and the command that writes it.
WRITTEN: dict[str, tuple[str, Command]] = {
    "opendrive": ("map.xodr", export("twin", "opendrive")),
    "geojson": ("lanes.geojson", export("twin", "geojson")),
    "plan": ("plan.svg", export("twin", "plan")),
    "glb": ("scene.glb", export("twin", "glb")),
    "obj": ("scene.obj", export("twin", "obj")),
    "ply": ("scene.ply", export("twin", "ply")),
    "usd": ("scene.usd", export("twin", "usd")),
    "fbx": ("scene.fbx", export("twin", "fbx")),
    "cityjson": ("town.city.json", export("twin", "cityjson")),
    "tracks": ("tracks.csv", export("motion", "tracks")),
    "openlabel": ("openlabel.json", export("motion", "openlabel")),
    "openscenario": ("traffic.xosc", export("motion", "openscenario")),
    "mcap": ("drive.mcap", export("dataset", "mcap")),
    "film": ("film.gif", lambda line, out: [
        "traffic", "film", line.motion.folder, "-o", out, "--stop", 0.2, "--fps", 5, "--width", 320,
        "--view", "above"]),
    "check picture": ("weak.png", lambda line, out: ["site", "check", line.site, "--picture", out]),
    "check page": ("weak.html", lambda line, out: ["site", "check", line.site, "--page", out]),
    "actors": ("actors.png", lambda line, out: [
        "catalogue", "actors", "motorcycle", "--save", out]),
    "page": ("page.html", lambda line, out: ["view", line.dataset.folder, "--save", out]),
    "rerun": ("view.rrd", lambda line, out: [
        "view", line.dataset.folder, "--rerun", out, "--no-browser"]),
}  # fmt: skip
#: Of these the refusal alone: making them takes a recording that is long enough.
REFUSED: dict[str, tuple[str, Command]] = {
    "openpcdet": ("pillars.yaml", export("dataset", "openpcdet")),
    "split": ("split.json", lambda line, out: [
        "dataset", "split", line.dataset.folder, line.dataset.folder, "--by", "scenario",
        "-o", out]),
    "align": ("rig.yaml", lambda line, out: [
        "rig", "align", line.dataset.folder, line.twin.folder, "-o", out]),
    "align picture": ("rig.png", lambda line, out: [
        "rig", "align", line.dataset.folder, line.twin.folder, "--picture", out,
        "-o", out.with_name("new.yaml")]),
    "background": ("background.npz", lambda line, out: [
        "rig", "background", line.dataset.folder, "--twin", line.twin.folder, "-o", out]),
    "discover": ("rig.yaml", lambda line, out: ["rig", "discover", line.dataset.folder, "-o", out]),
    "discover picture": ("rig.png", lambda line, out: [
        "rig", "discover", line.dataset.folder, "--picture", out, "-o", out.with_name("new.yaml")]),
}  # fmt: skip
#: Of one writer, as ``glb`` is.
SCENES = ("obj", "ply", "usd", "fbx", "cityjson")
FEW = [name for name in WRITTEN if name not in SCENES]
#: Written into a folder of a run, or by `init`, which has ``--force``; by `suite` see its tests.
ELSEWHERE = {None, "card", "improvement", "suite"}


def test_every_single_file_is_among_the_cases() -> None:
    kinds = set()
    for module in MODULES:
        text = module.read_text(encoding="utf-8")
        if "replaced_file(" in text:
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "replaced_file":
                    kind = next(one.value for one in node.keywords if one.arg == "kind")
                    kinds |= {kind.value} if isinstance(kind, ast.Constant) else set()
    assert kinds - ELSEWHERE <= set(WRITTEN) | set(REFUSED)
    assert {name for name, one in FORMATS.items() if one.is_file(Path(f"x{one.ending}"))} <= set(
        WRITTEN
    )


def run(case: tuple[str, Command], line: Line, out: Path, *more: str) -> int:
    return main([*map(str, case[1](line, out)), "--quiet", *more])


@pytest.mark.parametrize("name", [*FEW, *REFUSED, *further(*SCENES)])
def test_what_is_not_ours_is_not_replaced(
    name: str, line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = (WRITTEN | REFUSED)[name]
    out = tmp_path / case[0]
    out.write_bytes(b"my thesis")
    assert run(case, line, out) == 2
    said = capsys.readouterr().err
    assert "urbantwin did not write it" in said
    assert "--overwrite" in said
    assert len(said.splitlines()) == 1
    assert out.read_bytes() == b"my thesis"
    out.unlink()
    os.mkfifo(out)
    (tmp_path / "link").mkdir()
    link = tmp_path / "link" / case[0]
    link.symlink_to(out)
    for target in (out, link):
        for more in ((), ("--overwrite",)):
            assert run(case, line, target, *more) == 2
            assert "is a pipe" in capsys.readouterr().err
    assert stat.S_ISFIFO(out.stat().st_mode)
    assert link.is_symlink()


@pytest.mark.parametrize("name", [*FEW, *further(*SCENES)])
def test_what_is_ours_is_replaced_and_keeps_its_mode(
    name: str, line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = WRITTEN[name]
    out = tmp_path / case[0]
    out.write_bytes(b"my thesis")
    out.chmod(0o600)
    assert run(case, line, out, "--overwrite") == 0, capsys.readouterr().err
    assert out.read_bytes() != b"my thesis"
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    assert run(case, line, out) == 0, capsys.readouterr().err
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    out.chmod(0o444)
    before = out.read_bytes()
    assert run(case, line, out) == 2
    assert "is read-only" in capsys.readouterr().err
    out.chmod(0o644)
    out.write_bytes(before + b"\n my own change")
    assert run(case, line, out) == 2
    assert "was changed after urbantwin wrote it" in capsys.readouterr().err
    assert out.read_bytes() == before + b"\n my own change"


def test_one_output_does_not_replace_another(line: Line, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out.json"
    assert run(WRITTEN["openlabel"], line, out) == 0
    before = out.read_bytes()
    assert run(WRITTEN["tracks"], line, out) == 2
    assert "another output of urbantwin (openlabel)" in capsys.readouterr().err
    assert out.read_bytes() == before


def test_a_link_to_a_file_stays_and_its_file_is_judged(line: Line, tmp_path: Path) -> None:
    real, link = tmp_path / "real" / "tracks.csv", tmp_path / "tracks.csv"
    real.parent.mkdir()
    real.write_bytes(b"mine")
    link.symlink_to(real)
    assert run(WRITTEN["tracks"], line, link) == 2
    assert real.read_bytes() == b"mine"
    assert run(WRITTEN["tracks"], line, link, "--overwrite") == 0
    assert link.is_symlink()
    assert real.read_bytes() != b"mine"
    assert run(WRITTEN["tracks"], line, link) == 0


def test_the_folder_of_an_artefact_keeps_its_mode(line: Line, tmp_path: Path) -> None:
    out = tmp_path / "motion"
    arguments = ["drive", str(line.twin.folder), "-o", str(out), "--seconds", "0.2", "-q"]
    out.mkdir(mode=0o700)
    for _ in range(2):
        assert main([*arguments]) == 0
        assert stat.S_IMODE(out.stat().st_mode) == 0o700
