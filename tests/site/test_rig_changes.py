"""Changes to a rig for one recording."""

from typing import Any

import pytest

from urbantwin.errors import InputError
from urbantwin.site.rig import Conditions, Effects, RigSpec
from urbantwin.site.rig_changes import RigChanges

from .conftest import SENSOR


def rig(**fields: Any) -> RigSpec:
    one = SENSOR | {"effects": {"noise": False}}
    two = SENSOR | {"name": "b"}
    return RigSpec.model_validate({"sensors": [one, two], **fields})


def effects_after(text: str) -> list[set[str]]:
    """Which effects of both sensors are on."""
    changed = RigChanges(effects=text).applied_to(rig())
    return [
        {name for name, on in one.effects.model_dump().items() if on} for one in changed.sensors
    ]


EVERY = set(Effects.model_fields)


def test_effects_are_changed_from_left_to_right() -> None:
    assert effects_after("none") == [set(), set()]
    assert effects_after("all") == [EVERY, EVERY]
    assert effects_after("none,noise,dropout") == [{"noise", "dropout"}] * 2
    usual = EVERY - {"crosstalk"}
    assert effects_after("no-sun") == [usual - {"sun", "noise"}, usual - {"sun"}]
    assert effects_after(" crosstalk , no-rolling-shutter") == [
        (EVERY - {"rolling_shutter", "noise"}),
        EVERY - {"rolling_shutter"},
    ]


def test_each_effect_can_be_turned_off_alone() -> None:
    for name in EVERY:
        assert effects_after(f"all,no-{name}") == [EVERY - {name}] * 2


def test_nothing_is_changed_that_was_not_asked_for() -> None:
    given = rig(conditions={"weather": "fog", "visibility_m": 90.0}, fused=False)
    assert RigChanges().applied_to(given) == given
    changed = RigChanges(visibility_m=50.0).applied_to(given)
    assert changed.conditions == Conditions(weather="fog", visibility_m=50.0)
    assert RigChanges(fused=True).applied_to(given).fused
    assert changed.sensors == given.sensors


def test_another_carrier() -> None:
    one = {"name": "a", "model": "OS1-64", "forward_m": 0.0, "left_m": 0.0, "above_roof_m": 0.1}
    riding = RigSpec.model_validate({"ride": {"class": "bus"}, "sensors": [one]})
    by_track = RigChanges(ride="12").applied_to(riding).ride
    by_class = RigChanges(ride="car").applied_to(riding).ride
    assert by_track is not None
    assert by_class is not None
    assert (by_track.track, by_track.actor_class) == (12, None)
    assert (by_class.track, by_class.actor_class) == (None, "car")
    with pytest.raises(InputError, match="command line: class: is 'dog'; expected one of car"):
        RigChanges(ride="dog").applied_to(riding)
    with pytest.raises(InputError, match="--ride: the rig is static"):
        RigChanges(ride="car").applied_to(rig())


@pytest.mark.parametrize(("changes", "words"), [
    ({"effects": "nois"}, "--effects: there is no effect 'nois'; expected all, none.*'noise'"),
    ({"effects": ""}, "there is no effect ''"),
    ({"weather": "hail"}, "weather: is 'hail'; expected 'clear', 'rain', 'fog' or 'snow'"),
    ({"visibility_m": -5.0}, "visibility_m: is -5.0; expected more than 0"),
    ({"visibility_m": float("nan")}, "visibility_m: is nan"),
    ({"wet_ground": 1.5}, "wet_ground: is 1.5; expected at most 1"),
    ({"sun_elevation_deg": 91.0}, "sun_elevation_deg: is 91.0; expected at most 90"),
])  # fmt: skip
def test_changes_that_make_no_sense(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        RigChanges(**changes).applied_to(rig())
