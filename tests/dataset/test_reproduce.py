"""A tiny site from its map to its dataset, and the dataset made again from its manifest."""

import json
import re
import shutil
import socket
from contextlib import nullcontext
from pathlib import Path

import pytest
import yaml

import urbantwin.lidar
from urbantwin.artefact import read_json, write_json
from urbantwin.cli import main
from urbantwin.dataset.reproduction import make_again, plan_of
from urbantwin.download import allowed_keys_file
from urbantwin.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues"
CATALOGUE = Path(urbantwin.lidar.__file__).parent / "sensors"
QUICK = {"columns": 900, "effects": False}
RING = [[9.17962, 48.69971], [9.180431, 48.69969], [9.180457, 48.700361], [9.17964, 48.70032]]


def run(*arguments):
    return main([str(one) for one in arguments])


def silent(_title):
    return nullcontext(lambda share, doing: None)


def again(path, **how):
    return make_again(plan_of(path, **how), stage=silent, workers=1)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A site in a folder of its own, its twin and motion, and its inputs moved elsewhere."""
    root = tmp_path_factory.mktemp("made")
    site = root / "site"
    (site / "maps").mkdir(parents=True)
    for name in ("two-avenues.osm", "two-avenues-dem.tif"):
        shutil.copy(EXAMPLE / name, site / "maps")
    own = yaml.safe_load((CATALOGUE / "vlp-16.yaml").read_text())
    (site / "own.yaml").write_text(yaml.safe_dump({**own, "name": "Own", "aliases": []}))
    ring = {"type": "Polygon", "coordinates": [[*RING, RING[0]]]}
    (site / "region.geojson").write_text(json.dumps(ring))
    places = {"a": (9.0, -9.0), "b": (-9.0, 9.0)}
    sensors = [
        {**QUICK, "name": name, "model": model, "east_m": east, "north_m": north, "height_m": 4.0}
        for (name, (east, north)), model in zip(places.items(), ("own.yaml", "VLP-16"), strict=True)
    ]
    document = {
        "name": "tiny",
        "anchor": {"latitude": 48.7, "longitude": 9.18},
        "region": {"polygon": "region.geojson"},
        "osm": {"file": "maps/two-avenues.osm", "licence": "CC0-1.0", "attribution": "nobody"},
        "dem": "maps/two-avenues-dem.tif",
        "closed_loop": False,
        "traffic": {"per_hour": {"car": 3000}, "duration_s": 9, "warmup_s": 5},
        "rig": {"rate_hz": 5, "sensors": sensors},
    }
    (site / "site.yaml").write_text(yaml.safe_dump(document))
    (site / "rig.yaml").write_text(yaml.safe_dump({"rate_hz": 5, "sensors": sensors}))
    (site / "demand.yaml").write_text("per_hour: {bus: 900}\nsize: {bus: {length: 1.1}}\n")
    twin, motion = root / "twin", root / "motion"
    assert run("build", site / "site.yaml", "-o", twin, "--no-pictures", "-q") == 0
    asked = ("--seconds", "0.5", "--seed", "3", "--demand", site / "demand.yaml")
    assert run("drive", twin, "-o", motion, *asked, "-q") == 0
    record = ("record", twin, motion, "--no-pictures", "-q", "--workers", "1", "--stop", "0.2")
    assert run(*record, "-o", root / "dataset") == 0
    separate = ("--separate", "--rig", site / "rig.yaml", "--weather", "rain", "--start", "0.2")
    assert run(*record, "-o", root / "parts", *separate, "--visibility", "300") == 0
    (site / "site.yaml").unlink()
    site.rename(root / "elsewhere")
    return root


@pytest.fixture
def copy(made, tmp_path):
    """The dataset in a folder where nothing else is."""
    return shutil.copytree(made / "dataset", tmp_path / "far" / "dataset")


def changed(folder, **fields):
    write_json(folder / "dataset.json", read_json(folder / "dataset.json", kind="dataset") | fields)


def shortcut(made):
    return {"inputs": [made / "elsewhere"], "twin": made / "twin", "motion": made / "motion"}


def test_the_manifest_alone_and_the_inputs_give_the_same_bytes(made, tmp_path, capfd):
    """Without any of the dataset's files, the twin or the motion; and it can be kept."""
    alone = tmp_path / "alone"
    alone.mkdir()
    shutil.copy(made / "dataset" / "dataset.json", alone)
    out = tmp_path / "again"
    inputs = ("--inputs", made / "elsewhere")
    assert (
        run(
            "dataset",
            "reproduce",
            alone / "dataset.json",
            *inputs,
            "-o",
            out,
            "--workers",
            "1",
            "--json",
        )
        == 0
    )
    told = json.loads(capfd.readouterr().out)
    assert told["same"]
    assert told["versions"] == []
    files = {
        one.relative_to(made / "dataset"): one.read_bytes()
        for one in (made / "dataset").rglob("*")
        if one.is_file()
    }
    assert told["files"] == len(files) - 2  # all but the inventory and the card
    assert all((out / "dataset" / name).read_bytes() == data for name, data in files.items())
    assert (out / "twin" / "twin.json").read_bytes() == (made / "twin" / "twin.json").read_bytes()
    assert str(made) not in (alone / "dataset.json").read_text()
    assert [one.name for one in alone.iterdir()] == ["dataset.json"]


@pytest.mark.thorough
def test_sensors_apart_on_another_rig(made, tmp_path):
    """A dataset for each sensor; also of one of them; the scratch beside it goes."""
    parts = shutil.copytree(made / "parts", tmp_path / "far" / "parts")
    report = again(parts, **shortcut(made))
    assert report == {"same": True, "files": 1 + 2 * (1 + 4 + 11)}
    alone = tmp_path / "one"
    alone.mkdir()
    shutil.copy(parts / "b" / "dataset.json", alone)
    assert again(alone, **shortcut(made)) == {"same": True, "files": 16}
    assert [one.name for one in (tmp_path / "far").iterdir()] == ["parts"]


def test_a_damaged_frame_is_told_from_one_that_differs(made, copy):
    frame = copy / "points" / "000001.npy"
    frame.write_bytes(frame.read_bytes()[:-1] + b"!")
    report = again(copy, **shortcut(made))
    assert not report["same"]
    assert report["first"] == ["points/000001.npy"]
    assert report["by_folder"] == {"points": 1}
    assert report["earliest"] == "frames"
    assert report["why"] == [
        "points/000001.npy is damaged: not what was written (SHA256SUMS)",
        "what was made again is what was written",
    ]


def test_another_version_is_said_before_and_as_the_reason(made, copy, capfd):
    numbers = read_json(copy / "dataset.json", kind="dataset")["dependencies"]
    changed(copy, urbantwin="0.0.7", dependencies={**numbers, "numpy": "1.0"})
    options = [str(one) for name in ("twin", "motion") for one in (f"--{name}", made / name)]
    inputs = ("--inputs", made / "elsewhere")
    assert run("dataset", "reproduce", copy, *inputs, *options, "--workers", "1", "--json") == 1
    shown = capfd.readouterr()
    told = json.loads(shown.out)
    assert not told["same"]
    assert (told["first"], told["earliest"]) == (["dataset.json"], "manifest")
    assert told["versions"][0]["of"] == "urbantwin"
    assert [one["then"] for one in told["versions"] if one["of"] == "numpy"] == ["1.0"]
    assert any("urbantwin was 0.0.7" in one for one in told["why"])
    said = shown.err.splitlines()
    assert said[0].startswith("may change bytes: urbantwin was 0.0.7, is")
    assert said[-1].startswith("error: ")


def test_inputs_that_are_missing_or_changed(made, copy, tmp_path, capfd):
    """One line names the first, `--json` has all; nothing is made."""
    inputs = shutil.copytree(made / "elsewhere", tmp_path / "inputs")
    (inputs / "own.yaml").unlink()
    with (inputs / "maps" / "two-avenues.osm").open("a") as stream:
        stream.write("<!-- one more -->")
    assert run("dataset", "reproduce", copy, "--inputs", inputs, "--json") == 2
    shown = capfd.readouterr()
    missing = json.loads(shown.out)["missing"]
    assert [one["name"] for one in missing] == ["two-avenues.osm", "own.yaml"]
    assert missing[0]["is"].startswith("was found with other content")
    assert missing[1]["is"] == "is not found"
    (line,) = shown.err.splitlines()
    assert re.search(r"two-avenues\.osm \(osm, SHA-256 \w{64}, CC0-1\.0, nobody\) was found", line)
    assert "1 more cannot be used" in line
    assert [one.name for one in copy.parent.iterdir()] == ["dataset"]


def test_what_cannot_be_made_again_is_refused(made, copy, tmp_path):
    whole = read_json(copy / "dataset.json", kind="dataset")
    source = whole["made_from"]

    def line(file=copy / "dataset.json", **fields):
        write_json(file, whole | fields)
        with pytest.raises(InputError) as caught:
            plan_of(file, inputs=[made / "elsewhere"])
        return str(caught.value)

    assert "its motion was changed after" in line(motion_sha256="ab" * 32)
    assert "what its motion was made from" in line(made_from={**source, "motion": None})
    assert "expected a recording that" in line(made_from={**source, "record": None})
    assert "seeds.record" in line(seeds={"record": -1, "traffic": 1})
    old = {key: value for key, value in whole.items() if key != "made_from"}
    write_json(copy / "dataset.json", old)
    with pytest.raises(InputError, match="as datasets of earlier versions do not"):
        plan_of(copy)
    write_json(copy / "dataset.json", whole)
    with pytest.raises(InputError, match="has other actors"):
        other = shutil.copytree(made / "motion", tmp_path / "other")
        shutil.copy(other / "signals.parquet", tmp_path)
        assert run("drive", made / "twin", "-o", other, "--seconds", "0.2", "-q") == 0
        plan_of(copy, motion=other)
    with pytest.raises(InputError, match="is inside an input"):
        make_again(plan_of(copy, inputs=[made / "elsewhere"]), stage=silent, out=copy / "again")
    with pytest.raises(InputError, match="is also an input"):
        make_again(plan_of(copy, inputs=[made / "elsewhere"]), stage=silent, out=copy.parent)


@pytest.mark.parametrize("name", ["../../secret.osm", "/etc/passwd", "", "a\0b"])
def test_no_manifest_names_a_file_elsewhere(made, copy, name):
    whole = read_json(copy / "dataset.json", kind="dataset")
    sources = whole["made_from"]["twin"]["made_from"]
    sources["site"]["osm"]["file"] = name
    write_json(copy / "dataset.json", whole)
    with pytest.raises(InputError, match="its list of files"):
        plan_of(copy, inputs=[made / "elsewhere"])
    sources["files"][0]["name"] = name
    write_json(copy / "dataset.json", whole)
    with pytest.raises(InputError, match=r"without a folder|files\[0\]\.name"):
        plan_of(copy, inputs=[made / "elsewhere"])


@pytest.mark.parametrize("listed", [True, False])
def test_no_key_is_read_for_a_manifest(made, copy, tmp_path, monkeypatch, listed):
    """Whether its list of files names the address, or leaves it out to be overlooked."""
    monkeypatch.setenv("URBANTWIN_K", "s3cret")
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.05)
        origin = f"http://127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        allowed_keys_file().parent.mkdir()
        allowed_keys_file().write_text(f"URBANTWIN_K={origin}\n", encoding="utf-8")
        whole = read_json(copy / "dataset.json", kind="dataset")
        sources = whole["made_from"]["twin"]["made_from"]
        sources["site"]["geometry"] = [{"url": f"{origin}/t.json", "key_env": "URBANTWIN_K"}]
        if listed:
            entry = {"at": ["geometry", 0, "url"], "name": f"{origin}/t.json", "sha256": ""}
            sources["files"].append(entry)
        write_json(copy / "dataset.json", whole)
        with pytest.raises(InputError, match=r"no key is read here|never sends|its list of files"):
            make_again(
                plan_of(copy, inputs=[made / "elsewhere"]), stage=silent, out=tmp_path / "again"
            )
        with pytest.raises(TimeoutError):
            server.accept()
