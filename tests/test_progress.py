"""How far a long function is, and how its parts tell it."""

from urbantwin.progress import Progress, between, each


def recorder() -> tuple[list[tuple[float, str]], Progress]:
    told: list[tuple[float, str]] = []
    return told, lambda share, doing: told.append((share, doing))


def test_a_part_tells_its_share_of_the_whole() -> None:
    told, tell = recorder()
    inner = between(between(tell, 0.2, 0.6, "scene"), 0.5, 1.0, "walls")
    for share in (-1.0, 0.0, 0.5, 1.0, 7.0):
        inner(share, "")
    assert [share for share, _ in told] == [0.4, 0.4, 0.5, 0.6, 0.6]
    inner(0.0, "north")
    assert told[0][1] == "scene: walls"
    assert told[-1][1] == "scene: walls: north"


def test_things_tell_before_each_what_is_done() -> None:
    told, tell = recorder()
    assert list(each("abcd", tell, "letters")) == list("abcd")
    assert told == [(0.0, "letters"), (0.25, "letters"), (0.5, "letters"), (0.75, "letters")]
    assert list(each([], tell)) == []
