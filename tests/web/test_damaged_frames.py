"""A frame that is damaged in the middle is said, and the rest is shown."""

import http.client
import json
import shutil
from urllib.parse import urlsplit

import numpy as np
import pytest

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.web import open_shown
from urbantwin.web.chosen_frames import ChosenFrames
from urbantwin.web.wanted import Wanted


@pytest.fixture
def broken(dataset, tmp_path):
    """Six frames, of which the second to the fifth are each damaged in another way."""
    folder = tmp_path / "someone" / "dataset"
    shutil.copytree(dataset, folder, ignore=lambda *_: ["pictures"])
    points = folder / "points"
    whole = (points / "000001.npy").read_bytes()
    (points / "000001.npy").write_bytes(whole[: len(whole) // 2])
    (points / "000002.npy").unlink()
    (folder / "semantic" / "000003.label").write_bytes(b"abc")
    values = np.load(points / "000004.npy")
    values[:] = np.nan
    np.save(points / "000004.npy", values)  # as long as it should be
    return folder


def test_what_can_be_seen_at_once_is_said_at_once(broken, unpacked):
    shown = open_shown(Wanted(broken, frames=ChosenFrames.of("0:6", 1)))
    errors = [one["error"] for one in shown.document()["sides"][0]["frames"]]
    assert errors[0] is errors[4] is errors[5] is None
    assert errors[1].startswith("points/000001.npy: has ")
    assert errors[2] == "points/000002.npy: not found"
    assert errors[3].startswith("semantic/000003.label: has 3 bytes")
    for index in (0, 5):
        _, arrays = unpacked(shown.packet(f"points/0/{index}"))
        assert len(arrays["position"]) == len(np.load(broken / "points" / f"{index:06d}.npy"))
    for index in (1, 2, 3, 4):
        for kind in ("points", "boxes"):
            with pytest.raises(InputError):
                shown.packet(f"{kind}/0/{index}")
    said = shown.document()["sides"][0]["frames"][4]["error"]  # known since it was read
    assert said.startswith("points/000004.npy: ")
    assert not any(
        "someone" in (one["error"] or "") for one in shown.document()["sides"][0]["frames"]
    )


def test_the_server_says_it_in_a_sentence(broken, built_page):
    with ut.view(broken, frames="0:6", progress=False, browser=False) as page:
        address = urlsplit(page.address)
        connection = http.client.HTTPConnection(address.hostname, address.port, timeout=20)
        found = {}
        for index in range(6):
            connection.request("GET", f"{address.path}packet/points/0/{index}")
            answer = connection.getresponse()
            found[index] = answer.status, answer.getheader("content-type"), answer.read()
        connection.close()
        assert [found[index][0] for index in range(6)] == [200, 422, 422, 422, 422, 200]
        assert found[2][1].startswith("text/plain")
        assert found[2][2] == b"points/000002.npy: not found"
        assert "damaged" in page.summary()


def test_a_saved_page_says_it_too(broken, tmp_path, built_page):
    made = ut.view(broken, save=tmp_path / "page.html", frames="0:6", progress=False)
    text = made.path.read_text()
    assert "points/000004.npy" in text
    assert "someone" not in text
    document = json.loads(text.split('id="document">')[1].split("</script>")[0])
    assert [one["error"] is None for one in document["sides"][0]["frames"]] == [
        True, False, False, False, False, True,
    ]  # fmt: skip


def test_without_a_frame_that_can_be_read_it_is_refused(broken):
    with pytest.raises(InputError, match=r"00000[14]\.npy"):
        open_shown(Wanted(broken, frames=ChosenFrames.of("1:5", 1)))
