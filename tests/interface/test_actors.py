"""The catalogue of actors as people ask for it."""

import json

import numpy as np
import pytest
from PIL import Image

import urbantwin as ut
from urbantwin.cli import main


def test_the_table_lists_bodies_and_the_fleet(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["catalogue", "actors", "van", "--country", "DE"]) == 0
    text = capsys.readouterr().out
    catalogue = ut.catalogue.actors("van", country="DE")
    assert all(name in text for name in catalogue.names)
    assert "car-sedan" not in text
    low, middle, high = catalogue.sizes("van")["length"]
    assert 4.0 < low < middle < high < 7.5
    assert f"{middle:.2f}" in text


def test_as_json_it_has_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["catalogue", "actors", "bicycle", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {one["name"] for one in told["actors"]} == set(ut.catalogue.actors("bicycle").names)
    assert set(told["fleet"]) == {"bicycle"}


def test_the_picture_shows_every_body(tmp_path) -> None:
    path = tmp_path / "vans.png"
    ut.catalogue.actors("van", save=path, progress=False)
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB"), np.int64)
    # Under the title, in every place of the first row, there is something on the ground.
    ground = pixels[80, 5]
    for column in range(8):
        place = pixels[75:205, column * 210 + 20 : column * 210 + 190]
        assert (np.abs(place - ground).sum(axis=2) > 60).mean() > 0.08


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["tank"], "no class of actors 'tank'"),
        (["car", "--country", "Germany"], "two letters"),
        (["car", "--save", "cars.jpg"], "ends in .png"),
    ],
)
def test_what_cannot_be_is_one_line(arguments, problem, capsys) -> None:
    assert main(["catalogue", "actors", *arguments]) == 2
    assert problem in capsys.readouterr().err
