"""Saved pages, read as text: one file, nothing outside of it, the packets that the server gives."""

import base64
import gzip
import hashlib
import json
import re

import pytest

import urbantwin as ut
from urbantwin.artefact.written_files import RECORD
from urbantwin.errors import InputError
from urbantwin.web import open_shown, saved_page
from urbantwin.web.page_document import json_for_script
from urbantwin.web.wanted import Wanted

from .conftest import FRAMES

pytestmark = pytest.mark.usefixtures("built_page")
PACKET = re.compile(
    rb'<script type="application/octet-stream" data-packet="([^"]+)">([^<]*)</script>'
)
DOCUMENT = re.compile(rb'<script type="application/json" id="document">([^<]*)</script>')


@pytest.fixture(scope="module")
def page(dataset, tmp_path_factory, built_page):
    path = tmp_path_factory.mktemp("saved") / "page.html"
    return ut.view(dataset, save=path, frames="0:4", progress=False)


def test_its_packets_are_those_that_are_served(page, dataset):
    text = page.path.read_bytes()
    found = {
        name.decode(): gzip.decompress(base64.b64decode(data))
        for name, data in PACKET.findall(text)
    }
    names = {f"{kind}/0/{index}" for kind in ("points", "boxes") for index in range(4)}
    assert set(found) == names | {"twin", "tracks"}
    shown = open_shown(Wanted(dataset))
    for name in names:
        assert found[name] == shown.packet(name)
    document = json.loads(DOCUMENT.search(text)[1])
    assert [one["name"] for one in document["sides"][0]["frames"]] == [f"{k:06d}" for k in range(4)]
    assert document == page.document


def test_it_asks_for_nothing_and_allows_its_own_script_alone(page):
    text = page.path.read_text()
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)[1]
    policy = dict(part.strip().split(" ", 1) for part in policy.replace("&#x27;", "'").split(";"))
    assert policy["default-src"] == "'none'"
    assert "connect-src" not in policy
    for kind, tag in (("script-src", "script"), ("style-src", "style")):
        own = re.findall(rf"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        assert len(own) == 1
        digest = base64.b64encode(hashlib.sha256(own[0].encode()).digest()).decode()
        assert policy[kind] == f"'sha256-{digest}'"
    named = re.findall(r"<(?:script|link|img|iframe)\b[^>]*? (?:src|href)=([^ >]+)", text)
    assert named == ['"data:,"']  # no icon is asked for


def test_the_same_gives_the_same_bytes_and_names_nobody(page, dataset, tmp_path):
    again = ut.view(dataset, save=tmp_path / "other.html", frames="0:4", progress=False)
    assert again.path.read_bytes() == page.path.read_bytes()
    assert {one.name for one in tmp_path.iterdir()} == {"other.html", RECORD}
    for one in [*dataset.parts[1:-1], "/home", "/root"]:
        if len(one) > 5:
            assert one.encode() not in page.path.read_bytes(), one


def test_without_a_choice_it_holds_as_many_frames_as_fit(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(saved_page, "_USUAL_BYTES", 300_000)
    made = ut.view(dataset, save=tmp_path / "page.html", progress=False)
    document = json.loads(DOCUMENT.search(made.path.read_bytes())[1])
    count = len(document["sides"][0]["frames"])
    assert 1 <= count < FRAMES
    assert made.summary()["frames"] == count
    assert f"{FRAMES - count} frames" in made.summary()["left_out"]
    assert sum(len(data) for _, data in PACKET.findall(made.path.read_bytes())) < 400_000
    assert all(one["frame"] < count for one in document["events"])


def test_a_page_too_large_is_refused_and_leaves_nothing(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(saved_page, "MOST_BYTES", 400_000)
    with pytest.raises(InputError, match="fewer frames, by --frames or --every"):
        ut.view(dataset, save=tmp_path / "page.html", frames="0:25", progress=False)
    assert not list(tmp_path.iterdir())


def test_where_it_goes_is_checked_first(dataset, tmp_path):
    for name in ("page", "page.txt", "page.html/x.html"):
        (tmp_path / "page.html").touch()
        with pytest.raises(InputError):
            ut.view(dataset, save=tmp_path / name, progress=False)
    with pytest.raises(InputError):
        ut.view(dataset, save=dataset / "page.html", frames="0:1", progress=False)
    assert not (dataset / "page.html").exists()


def test_no_text_ends_its_script():
    value = {"title": "</script><script>alert(1)</script><!--&\u2028"}
    text = json_for_script(value)
    assert not set("<>&") & set(text)
    assert json.loads(text) == value
