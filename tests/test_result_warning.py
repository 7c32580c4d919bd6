"""Warnings about a result: their line, and what a manifest keeps of them."""

from urbantwin.result_warning import ResultWarning, rows_of, warnings_of


def test_a_warning_is_one_line_with_its_reason_and_a_remedy() -> None:
    full = ResultWarning("crossings", "5 of 11 are there", "no room", "look at plan.png")
    assert str(full) == "crossings: 5 of 11 are there: no room; look at plan.png"
    assert str(ResultWarning("points", "none")) == "points: none"
    assert "\n" not in str(ResultWarning("name\nof a\x1b street", "is left out"))


def test_a_manifest_keeps_warnings_and_may_hold_anything_in_their_place() -> None:
    told = [ResultWarning("a", "b", remedy="c"), ResultWarning("d", "e", "f")]
    assert rows_of(told)[0] == {"about": "a", "problem": "b", "remedy": "c"}
    assert list(warnings_of({"warnings": rows_of(told)})) == told
    for strange in (None, 3, "text", [1, None, "x"], [{}], {"problem": 1}):
        assert warnings_of({"warnings": strange}) == ()
    assert warnings_of({}) == ()
