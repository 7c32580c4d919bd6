"""Where inputs of a dataset are looked for, and what is told of those that are wrong."""

import hashlib

import pytest

from urbantwin.dataset.reproduction.inputs import Search
from urbantwin.twin.provenance import rig_and_files, without_secrets


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return hashlib.sha256(text.encode()).hexdigest()


def test_of_files_of_one_name_the_one_with_the_content_is_meant(tmp_path):
    write(tmp_path / "near" / "map.osm", "another")
    wanted = write(tmp_path / "far" / "a" / "b" / "map.osm", "this")
    write(tmp_path / "far" / ".hidden" / "secret.osm", "hidden")
    search = Search([(tmp_path / "near", 1), (tmp_path / "far", 6)])
    assert search.file("map.osm", wanted) == (tmp_path / "far/a/b/map.osm", None)
    assert search.file("map.osm", "0" * 64) == (None, tmp_path / "near/map.osm")
    assert search.file("other.osm", wanted) == (None, None)
    assert search.named("secret.osm") == []
    assert Search([(tmp_path / "far", 1)]).file("map.osm", wanted) == (None, None)


def test_files_that_belong_to_another_are_checked_one_by_one(tmp_path):
    """Tiles by their paths; what stands in a folder above or beside, by its name."""
    root = tmp_path / "scan" / "model"
    sums = {
        "tileset.json": write(root / "tileset.json", "{}"),
        "tiles/0/a.glb": write(root / "tiles/0/a.glb", "a"),
        "a.mtl": write(root / "below" / "a.mtl", "m"),
        "metadata.xml": write(tmp_path / "scan" / "metadata.xml", "<x/>"),
        "coords.txt": write(tmp_path / "scan" / "odm_georeferencing" / "coords.txt", "1"),
    }
    for place in (root, root / "tileset.json"):
        assert Search([]).wrong_beside(place, sums) == {}
    (root / "tiles/0/a.glb").write_text("changed")
    (root / "below" / "a.mtl").unlink()
    assert Search([]).wrong_beside(root, sums) == {
        "a.mtl": "is not found",
        "tiles/0/a.glb": "has other content",
    }


def test_a_rig_in_a_manifest_names_files_without_their_folders(tmp_path):
    """Also two of one name, and one that a Hesai model stands before."""
    one, two = (write(tmp_path / f"{name}/unit.csv", name) for name in ("one", "two"))
    models = ["one/unit.csv", f"Pandar64:{tmp_path}/two/unit.csv", "VLP-16"]
    rig, files = rig_and_files({"sensors": [{"model": name} for name in models]}, tmp_path)
    assert [one["model"] for one in rig["sensors"]] == ["unit.csv", "Pandar64:unit.csv", "VLP-16"]
    assert [(item["at"], item["sha256"]) for item in files] == [
        (["sensors", 0, "model"], one),
        (["sensors", 1, "model"], two),
    ]


@pytest.mark.parametrize(
    ("address", "kept"),
    [
        ("https://me:word@host:8443/a/tileset.json?key=1#x", "https://host:8443/a/tileset.json"),
        ("http://host/{z}/{x}/{y}.png", "http://host/{z}/{x}/{y}.png"),
        ("tiles/{z}/{x}/{y}.png", "tiles/{z}/{x}/{y}.png"),
    ],
)
def test_no_key_of_an_address_goes_into_a_manifest(address, kept):
    assert without_secrets(address) == kept
