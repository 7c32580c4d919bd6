"""Which secrets leave this machine: asked for by files of strangers, counted by a server."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.download import allowed_keys_file, key_for, keys_allowed
from urbantwin.errors import InputError

from .local_server import LocalServer, moved, plain

SECRET = "wJalrXUtnFEMI-secret"
EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues"


@pytest.fixture
def server() -> Iterator[LocalServer]:
    one = LocalServer({"/tiles/root.json": plain(b"{}")})
    yield one
    one.close()


@pytest.fixture
def configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's file of allowed pairs, which is not there yet."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    file = allowed_keys_file()
    assert file.is_relative_to(tmp_path / "config")
    file.parent.mkdir(parents=True)
    return file


def site_with(folder: Path, **fields: object) -> Path:
    """The example with more fields, in a folder of its own."""
    document = yaml.safe_load((EXAMPLE / "site.yaml").read_text(encoding="utf-8"))
    for name in ("osm", "dem"):
        document[name]["file"] = str(EXAMPLE / document[name]["file"])
    document["region"]["radius_m"] = 60
    site = folder / "site.yaml"
    site.write_text(yaml.safe_dump(document | fields), encoding="utf-8")
    return site


def sources(server: LocalServer, name: str) -> list[dict[str, object]]:
    return [
        {"geometry": [{"url": f"{server.url}/tiles/root.json", "key_env": name}]},
        {"imagery": [{"xyz": f"{server.url}/{{z}}/{{x}}/{{y}}", "zoom": 18, "key_env": name}]},
        {"imagery": [{"xyz": f"{server.url}/{{key}}/{{z}}/{{x}}/{{y}}", "key_env": name}]},
    ]


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("name", ["AWS_SECRET_ACCESS_KEY", "URBANTWIN_TILES_KEY"])
def test_a_strangers_site_gets_no_secret(
    number: int, name: str, server: LocalServer, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setenv(name, SECRET)
    site = site_with(tmp_path, **sources(server, name)[number])
    for command in ("build", "run"):
        assert main([command, str(site), "-o", str(tmp_path / "out"), "--quiet"]) == 2
        said = capsys.readouterr().err
        assert f"--allow-key {name}={server.url}" in said
        assert len(said.splitlines()) == 1
        assert SECRET not in said
    with pytest.raises(InputError, match="which you have not allowed"):
        ut.build(site, tmp_path / "out", progress=False)
    assert not server.heard
    assert not (tmp_path / "out").exists()


def test_what_the_line_says_to_type_sends_the_key(
    server: LocalServer, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setenv("TILES_KEY", SECRET)
    site = site_with(tmp_path, **sources(server, "TILES_KEY")[0])
    arguments = ["build", str(site), "-o", str(tmp_path / "out"), "--quiet"]
    assert main(arguments) == 2
    option, pair = re.search(r"(--allow-key) (\S+)", capsys.readouterr().err).groups()
    assert main([*arguments, option, pair]) == 2  # what is there is no tileset
    assert "not allowed" not in capsys.readouterr().err
    assert server.paths == [f"/tiles/root.json?key={SECRET}"]


def test_a_pair_allows_one_variable_and_one_origin(server: LocalServer, configuration: Path):
    environment = {"URBANTWIN_A": SECRET, "B": SECRET}
    here = f"{server.url}/x"
    with keys_allowed(None, [f"URBANTWIN_A={server.url}", "B=https://other.example"]):
        assert key_for("URBANTWIN_A", here, environment) == SECRET
        for name, address in (
            ("B", here),
            ("URBANTWIN_A", "http://127.0.0.1:1/x"),
            ("URBANTWIN_A", here.replace("http:", "https:")),
            ("URBANTWIN_A", here.replace("127.0.0.1", "localhost")),
            ("B", "http://other.example"),
            ("B", "https://other.example:8443"),
            ("B", "https://other.example.evil.example"),
        ):
            with pytest.raises(InputError, match="have not allowed"):
                key_for(name, address, environment)
        assert key_for("B", "https://OTHER.example/{key}/{z}", environment) == SECRET


def test_the_users_file_allows_pairs_and_no_names(server: LocalServer, configuration: Path):
    environment = {"URBANTWIN_A": SECRET, "B": SECRET}
    configuration.write_text(
        f"# mine\n\nURBANTWIN_A={server.url}\nB = {server.url}\n", encoding="utf-8"
    )
    assert key_for("URBANTWIN_A", server.url, environment) == SECRET
    with pytest.raises(InputError, match="does not begin with URBANTWIN_; expected --key-env B"):
        key_for("B", server.url, environment)
    with keys_allowed(["B"], None):
        assert key_for("B", server.url, environment) == SECRET
    configuration.write_text("URBANTWIN_A=https://host/path\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 1: is 'URBANTWIN_A=https://host/path'"):
        key_for("URBANTWIN_A", server.url, environment)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--allow-key", "NAME"),
        ("--allow-key", "=https://host"),
        ("--allow-key", "NAME=host"),
        ("--allow-key", "NAME=https://host/path"),
        ("--allow-key", "NAME=https://me:pass@host"),
        ("--key-env", "A B"),
        ("--key-env", ""),
    ],
)
def test_malformed_permissions_are_one_line(option: str, value: str, capsys) -> None:
    assert main(["build", str(EXAMPLE), "--quiet", option, value]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {option}: is ")
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("name", ["A; rm -rf ~", "A=B", "$(id)", "A\nB", ""])
def test_what_is_said_to_type_holds_no_command_of_a_stranger(name, server, tmp_path, capsys):
    for fields in sources(server, name):
        assert main(["build", str(site_with(tmp_path, **fields)), "--quiet"]) == 2
        assert "--allow-key" not in capsys.readouterr().err
    assert not server.heard


def test_a_redirect_elsewhere_has_no_key(server: LocalServer, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setenv("URBANTWIN_K", SECRET)
    other = LocalServer({"/t.json": plain(b"{}")})
    try:
        server.answers["/tiles/root.json"] = moved(f"{other.url}/t.json")
        spec = {"url": f"{server.url}/tiles/root.json", "key_env": "URBANTWIN_K"}
        site = site_with(tmp_path, geometry=[spec | {"origins": [other.url]}])
        pair = f"URBANTWIN_K={server.url}"
        assert main(["build", str(site), "--quiet", "--allow-key", pair]) == 2
        assert SECRET in server.heard[0]
        assert other.heard
        assert SECRET not in "".join(other.heard)
        assert SECRET not in capsys.readouterr().err
    finally:
        other.close()


def test_init_asks_before_a_table_of_sources_sends_a_key(
    server: LocalServer, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    table = tmp_path / "sources.yaml"
    row = {"name": "city", "title": "Ours", "kind": "map", "access": "overpass",
           "url": f"{server.url}/map?key={{key}}", "key_env": "AWS_SECRET_ACCESS_KEY"}  # fmt: skip
    table.write_text(yaml.safe_dump({"sources": [row]}), encoding="utf-8")
    arguments = ["init", str(tmp_path / "site"), "--at", "48.7,9.18", "--sources", str(table)]
    arguments += ["--use", "city", "--cache", str(tmp_path / "cache"), "--quiet"]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert f"--allow-key AWS_SECRET_ACCESS_KEY={server.url}" in said
    assert not server.heard
    assert main([*arguments, "--allow-key", f"AWS_SECRET_ACCESS_KEY={server.url}"]) == 2
    assert SECRET in server.heard[0]
    assert SECRET not in capsys.readouterr().err


def test_every_key_of_our_own_sources_has_our_prefix() -> None:
    from urbantwin.acquire import chosen_sources
    from urbantwin.acquire.source_table import known_sources

    named = [one.key_env for one in known_sources() if one.key_env]
    assert chosen_sources()
    assert named
    assert all(name.startswith("URBANTWIN_") for name in named)
