"""A build tells how far it is, part by part."""

from itertools import pairwise
from pathlib import Path

from urbantwin.site import load_site
from urbantwin.twin import build_twin

TWO_AVENUES = Path(__file__).parents[2] / "examples" / "two-avenues" / "site.yaml"


def test_a_build_moves_all_the_time(tmp_path: Path) -> None:
    told: list[tuple[float, str]] = []
    build_twin(
        load_site(TWO_AVENUES), tmp_path / "twin", lambda share, doing: told.append((share, doing))
    )
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    # No step is so large that a person would think that nothing moves.
    assert max(b - a for a, b in pairwise(shares)) < 0.15
    assert len(set(shares)) > 30
    for words in ("reading the map", "roads: heights", "scene: buildings", "scene: furniture"):
        assert any(doing.startswith(words) for _, doing in told), words
