"""Runs of SUMO that are kept: only the same input is answered from the cache."""

import os
import time
from pathlib import Path

from urbantwin.traffic.sumo.kept_runs import FILES, kept_run


def test_what_was_run_before_is_not_run_again(tmp_path: Path) -> None:
    net, cache, made = tmp_path / "net.xml", tmp_path / "cache", tmp_path / "made"
    net.write_text("<net/>")
    made.mkdir()
    runs = 0

    def run() -> None:
        nonlocal runs
        runs += 1
        for name in FILES:
            (made / name).write_text(f"{name} {runs}")

    def asked(seed: int = 1, cache: Path = cache) -> str:
        kept_run({"seed": seed}, [net], run, made, cache)
        one, other = [(made / name).read_text() for name in FILES]
        assert one == other.replace(FILES[1], FILES[0])
        return one.split()[-1]

    assert asked() == "1"
    assert asked() == "1"
    assert asked(seed=2) == "2"
    assert asked() == "1"
    net.write_text("<net />")
    assert asked() == "3"
    # A run that lost a file is none, and a cache that nobody can write neither.
    for kept in cache.iterdir():
        (kept / FILES[1]).unlink()
    assert [asked(), asked()] == ["4", "4"]
    assert asked(cache=net / "no folder") == "5"
    assert asked(cache=net / "no folder") == "6"


def test_what_a_killed_run_left_half_written_goes_after_an_hour(tmp_path: Path) -> None:
    cache, made = tmp_path / "cache", tmp_path / "made"
    made.mkdir()
    for name, age_s in ((".left", 4000.0), (".being-written", 10.0)):
        (cache / name).mkdir(parents=True)
        then = time.time() - age_s
        os.utime(cache / name, (then, then))
    for name in FILES:
        (made / name).write_text(name)
    kept_run({}, [], lambda: None, made, cache)
    assert [one.name for one in cache.glob(".*")] == [".being-written"]
    assert len(list(cache.iterdir())) == 2
