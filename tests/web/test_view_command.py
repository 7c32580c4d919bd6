"""``urbantwin view`` as a person meets it."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import urllib.request
from dataclasses import replace
from urllib.parse import urlsplit

import pytest

from urbantwin.cli import main
from urbantwin.errors import InputError
from urbantwin.web import open_shown, page_document
from urbantwin.web.wanted import Wanted

from ..thorough import further


@pytest.fixture
def said(capsys):
    def run(*arguments):
        code = main(["view", *map(str, arguments)])
        return code, capsys.readouterr()

    return run


@pytest.mark.parametrize("number", [signal.SIGINT, *further(signal.SIGTERM)])
def test_it_serves_until_it_is_ended(dataset, number, built_page):
    process = subprocess.Popen(
        [sys.executable, "-m", "urbantwin", "view", dataset, "--frames", "0:2", "-q", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "DISPLAY": "", "WAYLAND_DISPLAY": ""},
    )  # fmt: skip
    clients = []
    try:
        lines = []
        while not lines or not lines[-1].startswith("}"):
            lines.append(process.stdout.readline())
            assert lines[-1], process.stderr.read()
        address = re.search(r"http://127\.0\.0\.1:\d+/[0-9a-f]{32}/", "".join(lines))[0]
        with urllib.request.urlopen(address, timeout=20) as answer:
            assert answer.status == 200
        # Requests under way neither delay the end nor leave a traceback.
        port = int(address.split(":")[2].split("/")[0])
        path = urlsplit(address).path
        for which in range(50):
            client = socket.create_connection(("127.0.0.1", port), timeout=20)
            clients.append(client)
            request = f"GET {path}packet/points/0/{which % 2} HTTP/1.1\r\nHost: 127.0.0.1:{port}"
            client.sendall(f"{request}\r\n\r\n".encode())
        process.send_signal(number)
        out, error = process.communicate(timeout=60)
        assert (process.returncode, out, error) == (0, "", "")
    finally:
        for client in clients:
            client.close()
        process.kill()
        process.wait()


def test_a_folder_that_is_none_of_these_is_one_line(said, tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    code, out = said(tmp_path)
    assert code == 2
    assert out.err.count("\n") == 1
    assert "a twin, a motion, a dataset, a folder of real frames" in out.err


@pytest.mark.parametrize(
    "arguments",
    [("no-such-folder",), ("--port", "70000"), ("--frames", "x"), ("--every", "0"),
     ("--save", "page.pdf"), ("--rerun", "file.txt"), ("--detections", "nix"),
     ("--report", "nix"), ("--twin", "nix"), ("--motion", "nix")],
)  # fmt: skip
def test_what_is_wrong_is_one_line(said, dataset, arguments, tmp_path, monkeypatch, built_page):
    monkeypatch.chdir(tmp_path)
    given = arguments if arguments == ("no-such-folder",) else (dataset, *arguments)
    code, out = said(*given, "--no-browser")
    assert code == 2
    assert out.err.startswith("error: ")
    assert out.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_in_a_checkout_without_the_page_it_says_how_to_build_it(
    said, dataset, monkeypatch, tmp_path
):
    monkeypatch.setattr(page_document, "files", lambda _: tmp_path)
    code, out = said(dataset)
    assert code == 2
    assert "make web" in out.err


def test_a_motion_and_a_twin_are_shown(place, motion_of, twin, tmp_path, unpacked):
    car = {"track": 3, "class": "car", "asset": "car-sedan", "x": 2.0, "y": 5.0, "z": 1.0}
    car |= {"yaw": 0.5, "length": 4.0, "width": 2.0, "height": 1.5, "speed": 2.0, "time_s": 0.0}
    made = motion_of(twin, [car], steps=3)
    replace(made, manifest={"kind": "motion", "version": 1, **made.manifest}).save(
        tmp_path / "motion"
    )
    shown = open_shown(Wanted(tmp_path / "motion", twin=place / "twin"))
    document = shown.document()
    assert document["kind"] == "motion"
    assert document["twin"]["packet"] == "twin"
    assert [one["time_s"] for one in document["sides"][0]["frames"]] == [0.0, 0.1, 0.2]
    header, _ = unpacked(shown.packet("boxes/0/0"))
    assert header["boxes"][0]["box"] == [2.0, 5.0, 1.75, 4.0, 2.0, 1.5, 0.5]
    assert unpacked(shown.packet("boxes/0/2"))[0]["boxes"] == []
    with pytest.raises(KeyError):
        shown.packet("points/0/0")
    alone = open_shown(Wanted(place / "twin"))
    assert alone.document()["kind"] == "twin"
    assert alone.document()["sides"] == []
    assert alone.names() == ["twin"]


def test_a_motion_of_another_twin_is_not_shown_in_it(place, motion_of, twin, tmp_path):
    shutil.copytree(place / "twin", tmp_path / "twin")
    car = {"track": 3, "class": "car", "asset": "car-sedan", "time_s": 0.0}
    made = motion_of(twin, [car], steps=2)
    manifest = {"kind": "motion", "version": 1, **made.manifest}
    replace(made, manifest=manifest).save(tmp_path / "motion")
    assert open_shown(Wanted(tmp_path / "twin")).sides[0].name == "motion"
    other = {**manifest, "twin_sha256": "0" * 64}
    replace(made, manifest=other).save(tmp_path / "motion")
    assert open_shown(Wanted(tmp_path / "twin")).sides == []
    assert "twin" not in open_shown(Wanted(tmp_path / "motion")).layers
    with pytest.raises(InputError, match="not the twin that the motion was driven on"):
        open_shown(Wanted(tmp_path / "motion", twin=tmp_path / "twin"))
