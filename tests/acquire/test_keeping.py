"""The cache, offline work, interrupted work, and sites that stay what they were."""

import hashlib
import json
import time
from pathlib import Path

import pytest
import yaml

import urbantwin as ut
from urbantwin.acquire import AnswerCache, known_sources, remote_file
from urbantwin.acquire.answer_cache import now
from urbantwin.cli import main
from urbantwin.errors import InputError
from urbantwin.site import load_site
from urbantwin.site.pole_site import nearest_place

from .local_web import send_file
from .made_world import EXTRACT, cog, row

DEM = "/dem/N48E009.tif"


@pytest.fixture(autouse=True)
def _pole_without_a_search(monkeypatch):
    """Where the sensor stands is no matter here, and takes longer than all the rest."""
    monkeypatch.setattr("urbantwin.lidar.sight.place_in_sight", nearest_place)


def table_of(server):
    index = {"url": f"{server.url}/stac/catalog.json", "kind": "overture"}
    return [
        row(server, "osm", "map", "overpass", "/api/interpreter"),
        row(server, "dem", "elevation", "cog", DEM, crs="EPSG:4326+5783"),
        row(server, "survey", "airborne", "copc", "/survey.copc.laz"),
        row(server, "overture", "buildings", "geoparquet", index=index),
    ]


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_offline_gives_the_same_files_from_the_cache_and_asks_nobody(server, fetch):
    first = fetch(*table_of(server))
    assert len(first.inputs) == 4
    server.asked.clear()
    again = fetch(*table_of(server), offline=True, folder="again")
    assert not server.asked
    assert files(again.folder) == files(first.folder)
    assert {one.at for one in again.inputs.values()} == {one.at for one in first.inputs.values()}


def test_what_is_fresh_is_not_asked_for_again_and_what_is_old_is(server, fetch):
    fresh = {**table_of(server)[1], "fresh_days": 1.0}
    old = {**fresh, "fresh_days": 0.0}
    fetch(fresh)
    server.asked.clear()
    fetch(fresh, folder="fresh")
    assert DEM not in server.paths()
    time.sleep(1.1)  # answers are dated to the second
    fetch(old, folder="old")
    assert DEM in server.paths()


def test_an_old_answer_serves_where_the_server_does_not_and_that_is_told(server, fetch, area):
    old = {**table_of(server)[0], "fresh_days": 0.0}
    first = fetch(old)
    time.sleep(1.1)
    server.answers.clear()
    server.faults["/api/interpreter"] = []
    server.answers["/api/interpreter"] = lambda handler: handler.connection.close()
    again = fetch(old, folder="again")
    assert files(again.folder) == files(first.folder)
    (told,) = (str(one) for one in again.found.warnings if one.about == "osm")
    assert first.inputs["map"].at in told


def test_contents_are_kept_by_their_hash_and_damage_is_noticed(server, fetch, tmp_path):
    fetch(*table_of(server))
    kept = [path for path in (tmp_path / "cache" / "contents").rglob("*") if path.is_file()]
    assert len(kept) > 4
    assert all(hashlib.sha256(path.read_bytes()).hexdigest() == path.name for path in kept)
    for path in kept:
        path.write_bytes(path.read_bytes()[:-1] + b"?")
    server.asked.clear()
    again = fetch(*table_of(server), folder="again")
    assert len(again.inputs) == 4
    assert len(server.asked) >= 4


def test_a_file_that_was_half_read_is_read_on(server, fetch, monkeypatch):
    """The server dies in the middle of a file; what came before is not asked for again."""
    monkeypatch.setattr(remote_file, "AT_ONCE", remote_file.BLOCK)  # one request a block
    heights = cog(9.0, 48.0, 1.0, 1024)
    asked = []

    def dying(handler):
        asked.append(handler.headers["Range"])
        if len(asked) > 1:
            handler.connection.close()
        else:
            send_file(handler, heights)

    server.answers["/h.tif"] = dying
    table = row(server, "dem", "elevation", "cog", "/h.tif", crs="EPSG:4326+3855")
    assert fetch(table).outcome["dem"].outcome == "failed"
    server.answers["/h.tif"] = lambda handler: send_file(handler, heights)
    server.asked.clear()
    assert "elevation" in fetch(table, folder="again").inputs
    later = [headers["Range"] for path, headers in server.asked if path == "/h.tif"]
    assert later
    assert asked[0] not in later


def test_a_cache_of_damaged_records_is_none(tmp_path):
    cache = AnswerCache(tmp_path)
    cache.keep("request", b"data", "", 4)
    assert cache.find("request")[1] == b"data"
    (record,) = (tmp_path / "requests").rglob("*.json")
    for text in (b"", b"[]", b'{"sha256": 3}', b'{"sha256": "..", "at": "x", '
                 b'"version": "", "total": 4}'):  # fmt: skip
        record.write_bytes(text)
        assert cache.find("request") is None


@pytest.fixture
def site(server, own_table, tmp_path, capfd):
    """``site(options)``: the command's exit code and streams, of a place that is fetched."""

    def made(*options, folder="mysite"):
        table = own_table(*(one | {"caution": "made up"} for one in table_of(server)))
        capfd.readouterr()
        code = main(
            ["init", str(tmp_path / folder), "--at", "48.7,9.18", "--radius", "60", "--sources",
             str(table), "--cache", str(tmp_path / "cache"), "--use", "osm,dem,overture", *options]
        )  # fmt: skip
        out, err = capfd.readouterr()
        return code, out, err

    return made


def test_the_site_says_of_each_input_where_it_came_from(site, tmp_path):
    code, out, err = site("--json")
    assert code == 0
    told = json.loads(out)
    assert {(one["kind"], one["outcome"]) for one in told["sources"]} == {
        ("map", "fetched"), ("elevation", "fetched"), ("buildings", "fetched"),
        ("airborne", "not asked"), ("imagery", "not asked"),
    }  # fmt: skip
    assert "none was found" not in err
    assert "warning: dem: made up" in err
    written = yaml.safe_load((tmp_path / "mysite" / "site.yaml").read_text())
    for kind, source in (("osm", "osm"), ("dem", "dem"), ("buildings", "overture")):
        entry = written[kind]
        assert entry["licence"] == f"licence of {source}"
        assert entry["attribution"] == f"makers of {source}"
        assert entry["fetched"]["source"] == source
        assert entry["fetched"]["url"].startswith("http://127.0.0.1:")
        assert entry["fetched"]["at"] <= now()
    checked = load_site(tmp_path / "mysite" / "site.yaml")
    assert [(one["kind"], one["sha256"], one["licence"]) for one in checked.inputs()] == [
        (kind, written[kind]["fetched"]["sha256"], written[kind]["licence"])
        for kind in ("osm", "dem", "buildings")
    ]
    assert not [path.name for path in (tmp_path / "mysite").iterdir() if path.name[0] == "."]


def test_what_no_source_has_there_is_told(server, fetch):
    elsewhere = row(server, "far", "airborne", "copc", "/x", coverage=[[0, 0, 1, 1]])
    found = fetch(elsewhere).found
    told = {one.kind: one.outcome for one in found.attempts}
    assert told["airborne"] == "no source"
    assert told["imagery"] == "not asked"
    assert [one.about for one in found.warnings] == ["airborne LiDAR"]


def test_the_same_place_offline_is_the_same_site(site, tmp_path):
    assert site()[0] == 0
    code, _, _ = site("--offline", folder="again")
    assert code == 0
    first, again = (
        {path.relative_to(tmp_path / name): path.read_bytes()
         for path in sorted((tmp_path / name).rglob("*")) if path.is_file()}
        for name in ("mysite", "again")
    )  # fmt: skip
    assert first == again


def test_an_input_that_was_changed_is_refused(site, tmp_path):
    assert site()[0] == 0
    for path in sorted((tmp_path / "mysite" / "inputs").iterdir()):
        whole = path.read_bytes()
        path.write_bytes(whole + b"\n")
        with pytest.raises(InputError, match=r"is not what was fetched: its SHA-256 is another"):
            load_site(tmp_path / "mysite" / "site.yaml")
        path.write_bytes(whole)
    assert load_site(tmp_path / "mysite" / "site.yaml").buildings


def test_a_file_of_the_folder_is_replaced_only_by_force(site, tmp_path):
    (tmp_path / "mysite" / "inputs").mkdir(parents=True)
    mine = tmp_path / "mysite" / "inputs" / "map.osm"
    mine.write_text("mine")
    code, _, err = site()
    assert code == 2
    assert "map.osm: differs from what was fetched; expected a new folder, or --force" in err
    assert mine.read_text() == "mine"
    assert [path.name for path in mine.parent.iterdir()] == ["map.osm"]
    assert site("--force")[0] == 0
    assert mine.read_text() != "mine"


def test_a_place_without_streets_is_one_line_and_leaves_nothing(site, server, tmp_path):
    code, out, err = site("--at", "48.7,9.3")
    assert (code, out) == (2, "")
    assert err.splitlines()[-1].startswith(
        "error: --at: there is no street within 60 m of 48.7,9.3: "
    )
    assert "or a larger --radius; or latitude first: --at 9.3,48.7" in err
    assert server.paths() == ["/api/interpreter"]
    assert not (tmp_path / "mysite").exists()


def test_what_fails_beside_the_map_is_named_and_the_site_is_there(site, server, tmp_path):
    server.answers[DEM] = lambda handler: handler.connection.close()
    code, out, err = site()
    assert code == 0
    assert "warning: dem: elevation could not be fetched: cannot be fetched" in err
    assert "outcome failed" in out
    assert "dem" not in yaml.safe_load((tmp_path / "mysite" / "site.yaml").read_text())


def test_of_a_map_that_is_there_the_rest_is_fetched(server, own_table, tmp_path):
    made = ut.init(
        tmp_path / "mysite", osm=EXTRACT, at=(48.7, 9.18), radius=60, use="dem",
        sources=own_table(*table_of(server)), cache=tmp_path / "cache", progress=False,
    )  # fmt: skip
    assert set(server.paths()) == {DEM}
    inputs = {one["kind"]: one["name"] for one in made.checked.inputs()}
    assert inputs == {"osm": EXTRACT.name, "dem": "elevation.tif"}


def test_a_map_of_elsewhere_is_told_before_anybody_is_asked(server, own_table, tmp_path):
    options = {"sources": own_table(*table_of(server)), "progress": False, "use": "dem"}
    with pytest.raises(InputError, match=r"none\.osm: not found"):
        ut.init(tmp_path / "x", osm=tmp_path / "none.osm", at=(48.7, 9.18), **options)
    with pytest.raises(InputError, match=r"has no road within the region: the nearest is .* km"):
        ut.init(tmp_path / "x", osm=EXTRACT, at=(48.9, 9.18), **options)
    assert not server.asked
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("sources: [{name: a, kind: map, access: cog, title: a, url: 'http://x'}]", "overpass"),
        ("sources: [{name: a, kind: map, access: overpass, title: a}]", "url or index"),
        ("sources: [{name: a, kind: imagery, access: xyz, title: a, url: 'http://x/{z}'}]", "zoom"),
        ("sources: [{name: a, kind: elevation, access: cog, title: a, url: 'http://x/{q}'}]",
         "'q'"),
        ("sources: [{name: a, kind: elevation, access: cog, title: a, url: 'http://x/{key}'}]",
         "key_env"),
        ("sources: [{name: a, kind: elevation, access: cog, title: a, url: 'file:///x'}]",
         "not an address of HTTP"),
        ("sources: [{name: A b, kind: map, access: overpass, title: a, url: 'http://x'}]", "name"),
        ("source: []", "source"),
        ("sources: 3", "sources"),
        ("[1, 2", "own.yaml"),
    ],
)  # fmt: skip
def test_a_table_that_is_wrong_is_one_line(tmp_path, text, told):
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        ut.init(tmp_path / "x", at="48.7,9.18", sources=tmp_path / "own.yaml", progress=False)
    assert "own.yaml" in str(caught.value)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_source_of_the_package_tells_its_terms():
    for one in known_sources():
        assert one.licence != "not stated"
        assert one.attribution != "not stated"
        assert one.terms
        assert one.terms.startswith("https://")
        assert one.address.startswith("https://")
    usual = {one.kind for one in known_sources() if one.default}
    assert {"map", "names", "elevation", "airborne", "buildings", "imagery"} == usual
    assert not [one.name for one in known_sources() if one.key_env and one.default]


def test_the_page_of_the_documentation_names_every_source():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "formats.md").read_text()
    for one in known_sources():
        assert f"`{one.name}`" in page
