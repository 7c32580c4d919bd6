"""A build tells how far it is, part by part."""

import json
from itertools import pairwise

from urbantwin.twin import Twin


def test_a_build_moves_all_the_time(two_avenues_twin: Twin) -> None:
    told = json.loads((two_avenues_twin.folder.parent / "told.json").read_text())
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    # No step is so large that a person would think that nothing moves.
    assert max(b - a for a, b in pairwise(shares)) < 0.15
    assert len(set(shares)) > 30
    for words in ("reading the map", "roads: heights", "scene: buildings", "scene: furniture"):
        assert any(doing.startswith(words) for _, doing in told), words
