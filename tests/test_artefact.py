import pickle

import pytest

from urbantwin.artefact import read_json, replaced_folder, sha256_of, write_json
from urbantwin.errors import InputError


def test_a_folder_appears_whole(tmp_path):
    target = tmp_path / "deep" / "twin"
    with replaced_folder(target, kind="twin") as folder:
        write_json(folder / "twin.json", {"kind": "twin"})
        assert not target.exists()
    assert read_json(target / "twin.json", kind="twin") == {"kind": "twin"}
    assert [p.name for p in target.parent.iterdir()] == ["twin"]


def test_an_interruption_keeps_the_older_one(tmp_path):
    target = tmp_path / "twin"
    with replaced_folder(target, kind="twin") as folder:
        write_json(folder / "twin.json", {"kind": "twin", "number": 1})
    with pytest.raises(KeyboardInterrupt), replaced_folder(target, kind="twin") as folder:
        write_json(folder / "twin.json", {"number": 2})
        raise KeyboardInterrupt
    assert read_json(target / "twin.json", kind="twin")["number"] == 1
    assert [p.name for p in tmp_path.iterdir()] == ["twin"]


@pytest.mark.parametrize("other", ["motion", None])
def test_what_is_not_ours_is_never_replaced(tmp_path, other):
    (tmp_path / "out").mkdir()
    name = f"{other}.json" if other else "holiday.jpg"
    (tmp_path / "out" / name).write_text("{}")
    with (
        pytest.raises(InputError, match="holds other files"),
        replaced_folder(tmp_path / "out", kind="twin"),
    ):
        pass
    assert (tmp_path / "out" / name).exists()


def test_errors_are_one_line(tmp_path):
    error = InputError("is\nbad", file="a.yaml", place="x.y", expected="better")
    assert str(error) == "a.yaml: x.y: is bad; expected better"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    (tmp_path / "a.json").write_text("{")
    for path in (tmp_path / "a.json", tmp_path / "b.json"):
        with pytest.raises(InputError) as caught:
            read_json(path, kind="twin")
        assert "\n" not in str(caught.value)
        assert str(path) in str(caught.value)


def test_the_hash_is_sha256(tmp_path):
    (tmp_path / "abc").write_bytes(b"abc")
    # FIPS 180-2, appendix B.1
    assert sha256_of(tmp_path / "abc") == (
        "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    )
