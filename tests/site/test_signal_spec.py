"""``signals:`` of a ``site.yaml``: what is kept, and the line that each mistake gets."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from urbantwin.errors import InputError
from urbantwin.site import load_site

from .conftest import site_fields

PHASES = [{"seconds": 30, "green": ["north", "south"]}, {"seconds": 20, "green": ["east", "west"]}]


def test_plans_are_kept_and_written_again(write_site: Callable[[object], Path]) -> None:
    plan = {"junction": "A / B", "cycle": 60, "offset": 5, "phases": PHASES}
    path = write_site({**site_fields(), "signals": [plan]})
    site = load_site(path)
    assert site.signals[0].spec.streets == ("A", "B")
    again = path.with_name("again.yaml")
    again.write_text(yaml.safe_dump(site.resolved()))
    assert [p.spec for p in load_site(again).signals] == [p.spec for p in site.signals]
    assert load_site(write_site(site_fields())).signals == ()


@pytest.mark.parametrize(
    ("plan", "place", "expected"),
    [
        ({"offset": 4}, "signals[0].junction", "the id of a signalised junction"),
        ({"junction": True, "offset": 4}, "signals[0].junction", "names of streets"),
        ({"junction": {"lat": 4}, "offset": 4}, "signals[0].junction", "latitude and longitude"),
        (
            {"junction": {"latitude": 91, "longitude": 4}, "offset": 4},
            "signals[0].junction",
            "-90 to 90",
        ),
        ({"junction": "A"}, "signals[0]", "phases, states or an offset"),
        ({"junction": "A", "cycle": 5, "phases": PHASES}, "signals[0].cycle", "at least 10"),
        ({"junction": "A", "phases": []}, "signals[0].phases", "at least one"),
        (
            {"junction": "A", "phases": [{"seconds": 0, "green": ["north"]}]},
            "signals[0].phases[0].seconds",
            "more than 0",
        ),
        (
            {"junction": "A", "phases": [{"secnds": 9, "green": ["north"]}]},
            "signals[0].phases[0].secnds",
            "'seconds'",
        ),
        (
            {"junction": "A", "states": [{"seconds": 9, "state": "GGx"}]},
            "signals[0].states[0].state",
            "letters of GgyYruoOs",
        ),
        (
            {"junction": "A", "states": [{"seconds": 9, "state": "G", "at_least": 5}]},
            "signals[0].states[0]",
            "both at_least and at_most",
        ),
        (
            {
                "junction": "A",
                "states": [{"seconds": 9, "state": "G", "at_least": 10, "at_most": 20}],
            },
            "signals[0].states[0]",
            "between at_least and at_most",
        ),
        (
            {"junction": "A", "phases": PHASES, "states": [{"seconds": 9, "state": "G"}]},
            "signals[0]",
            "not both",
        ),
    ],
)
def test_a_mistake_is_told_in_one_line(
    plan: object, place: str, expected: str, write_site: Callable[[object], Path]
) -> None:
    path = write_site({**site_fields(), "signals": [plan]})
    with pytest.raises(InputError) as caught:
        load_site(path)
    text = str(caught.value)
    assert "\n" not in text
    assert f"{path}: {place}" in text
    assert expected in text
