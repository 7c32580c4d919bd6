"""Locales of other encodings: what is written and read is UTF-8 everywhere."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

from ..source_imports import MODULES
from .small_site import ROOT, Stand, bytes_of

#: As in a container, a cron job, or after ssh: neither UTF-8 nor told to be.
PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONPATH": str(ROOT / "src")}


def run(*command: object, **environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, *map(str, command)],
        env=os.environ | PLAIN | environment,
        capture_output=True,
        check=False,
    )


def test_the_whole_line_of_a_site_with_other_letters(stand: Stand, tmp_path: Path) -> None:
    """In folders, names of files, and what is said of them: the same bytes as in UTF-8."""
    place = tmp_path / "größe" / "Łódź"
    shutil.copytree(stand.site.parent, place)
    document = yaml.safe_load((place / "site.yaml").read_text(encoding="utf-8"))
    osm = place / document["osm"]["file"]
    document["osm"] |= {"file": "straße.osm", "attribution": "Größe, Łódź"}
    shutil.copyfile(osm, place / "straße.osm")
    document["name"] = "Straße & Łódź"
    (place / "site.yaml").write_text(yaml.safe_dump(document, allow_unicode=True), encoding="utf-8")
    found = []
    for environment in (PLAIN, {"LC_ALL": "C.UTF-8", "PYTHONUTF8": "1"}):
        for command in (
            ["build", place, "--no-pictures", "--json"],
            ["record", place / "twin", place / "motion", "--stop", "0.2", "--workers", "2",
             "--no-pictures", "-q"],
        ):  # fmt: skip
            if command[0] == "record":
                made = next(place.glob("*/twin"))
                done = run("-m", "urbantwin", "drive", made, "-q", **environment)
                assert done.returncode == 0, done.stderr
                command[1:3] = [made, made.with_name("motion")]
            done = run("-m", "urbantwin", *command, **environment)
            assert done.returncode == 0, done.stderr
            if "--json" in command:
                assert json.loads(done.stdout)["name"] == "Straße & Łódź"
        assert "Größe, Łódź".encode() in (made / "twin.json").read_bytes()
        found.append(bytes_of(made.parent))
        shutil.rmtree(made.parent)
    assert found[0] == found[1]


def test_python_needs_no_locale(stand: Stand, tmp_path: Path) -> None:
    """A library cannot begin again in another mode: text of ours is UTF-8 even so."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys, urbantwin as ut\n"
        "twin = ut.build(sys.argv[1], sys.argv[2], pictures=False, progress=False)\n"
        "assert ut.open(twin.folder).manifest['name'] == 'Stra\\xdfe \\u0141'\n"
        "sys.stdout.write(sys.getfilesystemencoding())\n",
        encoding="utf-8",
    )
    place = shutil.copytree(stand.site.parent, tmp_path / "site")
    document = yaml.safe_load((place / "site.yaml").read_text(encoding="utf-8"))
    document["name"] = "Straße Ł"
    (place / "site.yaml").write_text(yaml.safe_dump(document, allow_unicode=True), encoding="utf-8")
    done = run(script, place, tmp_path / "twin")
    assert done.returncode == 0, done.stderr
    assert done.stdout != b"utf-8"
    done = run(
        "-c", f"import urbantwin as ut; ut.build({str(place)!r}, {str(tmp_path)!r} + '/Stra\\xdfe')"
    )
    assert b"lacks letters of its name" in done.stderr


def test_every_text_file_names_its_encoding() -> None:
    """As ruff's PLW1514 does where it knows that something is a path."""
    wrong = []
    for module in MODULES:
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or any(
                one.arg in ("encoding", None) for one in node.keywords
            ):
                continue
            name = getattr(node.func, "attr", "")
            modes = [one.value for one in node.args if isinstance(one, ast.Constant)]
            text = [one for one in modes if isinstance(one, str) and set(one) <= set("rwxat+")]
            if (
                (name == "write_text" and len(node.args) == 1)
                or (name == "read_text" and not node.args)
                or (name in ("open", "fdopen") and text and "tarfile" not in ast.unparse(node.func))
                or any(one.arg == "text" and name in ("run", "Popen") for one in node.keywords)
            ):
                wrong.append(f"{module}:{node.lineno}: {ast.unparse(node)[:60]}")
    assert not wrong, "\n".join(wrong)
