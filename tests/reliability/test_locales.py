"""Locales of other encodings: what is written and read is UTF-8 everywhere."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

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


@pytest.mark.thorough
def test_the_whole_line_of_a_site_with_other_letters(stand: Stand, tmp_path: Path) -> None:
    """In folders, names of files, and what is said of them: the same bytes as in UTF-8."""
    place = tmp_path / "größe" / "Łódź"
    shutil.copytree(stand.site.parent, place)
    document = yaml.safe_load((place / "site.yaml").read_text(encoding="utf-8"))
    osm = place / document["osm"]["file"]
    document["osm"] |= {"file": "straße.osm", "attribution": "Größe, Łódź"}
    shutil.copyfile(osm, place / "straße.osm")
    document["name"] = "Straße & Łódź"
    document["traffic"] |= {"duration_s": 0.3}
    (place / "site.yaml").write_text(yaml.safe_dump(document, allow_unicode=True), encoding="utf-8")
    made, workers = tmp_path / "Übung", ["--no-pictures", "--workers"]
    done = run("-m", "urbantwin", "run", place, "-o", made, *workers, "2", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["twin"] == str(made / "twin")
    twin = (made / "twin" / "twin.json").read_text(encoding="utf-8")
    assert {"Größe, Łódź", "Straße & Łódź"} <= set(re.findall(r'"([^"]*)"', twin))
    assert sys.getfilesystemencoding() == "utf-8"  # as this process has it
    found = bytes_of(made)
    shutil.rmtree(made)
    assert stand.ran(["run", place, "-o", made, *workers, "1"]) == (0, "")
    assert found == bytes_of(made)


def test_python_needs_no_locale(stand: Stand, tmp_path: Path) -> None:
    """A library cannot begin again in another mode: text of ours is UTF-8 even so."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys, urbantwin as ut\n"
        "try:\n"
        "    ut.build(sys.argv[1], sys.argv[2] + '/Stra\\xdfe', progress=False)\n"
        "except ut.InputError as error:\n"
        "    print(error, file=sys.stderr)\n"
        "twin = ut.build(sys.argv[1], sys.argv[2] + '/twin', pictures=False, progress=False)\n"
        "assert ut.open(twin.folder).manifest['name'] == 'Stra\\xdfe \\u0141'\n"
        "sys.stdout.write(sys.getfilesystemencoding())\n",
        encoding="utf-8",
    )
    place = shutil.copytree(stand.site.parent, tmp_path / "site")
    document = yaml.safe_load((place / "site.yaml").read_text(encoding="utf-8"))
    document["name"] = "Straße Ł"
    (place / "site.yaml").write_text(yaml.safe_dump(document, allow_unicode=True), encoding="utf-8")
    done = run(script, place, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout != b"utf-8"
    assert b"lacks letters of its name" in done.stderr
