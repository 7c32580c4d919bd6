"""Make what the gallery shows: ``python docs/site_build/gallery.py -o build/gallery``.

A run of `urbantwin run` may be given (``--run out/``); else the example is run first. Every file
has the name that ``docs/gallery.md`` shows it by; nothing of it is committed.
"""

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

import urbantwin as ut
from urbantwin.cli import main as main_of_commands

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "two-avenues" / "site.yaml"


def make(out: Path, run: Path | None = None, *, seconds: float = 6.0, width: int = 960) -> None:
    """Make the gallery's files in a folder, which is replaced when all are there.

    Args:
        out: the folder.
        run: twin, motion and dataset of `urbantwin run`; made of the example if not given.
        seconds: how long the film is.
        width: of the film, pixels.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent) as scratch:
        made = Path(scratch) / "gallery"
        made.mkdir()
        if run is None:
            run = Path(scratch) / "run"
            ut.run(EXAMPLE, out=run)
        twin, motion, dataset = (run / name for name in ("twin", "motion", "dataset"))
        for stage in (twin, motion, dataset):
            for picture in sorted((stage / "pictures").glob("*.png")):
                shutil.copyfile(picture, made / f"{stage.name}-{picture.name}")
        ut.traffic.film(motion, made / "film.gif", twin=twin, stop=seconds, fps=5, width=width)
        covered = ut.rig.coverage(twin, Path(scratch) / "coverage")
        shutil.copyfile(covered.folder / "coverage.png", made / "coverage.png")
        ut.catalogue.actors(save=made / "actors.png")
        save = ["--save", str(made / "dataset.html"), "--frames", "0:10", "--quiet"]
        if main_of_commands(["view", str(dataset), *save]) != 0:
            raise ut.StageError("the page of the dataset cannot be saved")
        if out.is_dir():
            shutil.rmtree(out)
        made.rename(out)


def main() -> None:
    """Read the options, make the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "build" / "gallery")
    parser.add_argument("--run", type=Path, help="a run to show; the example's if not given")
    told = parser.parse_args()
    try:
        make(told.out, told.run)
    except ut.UrbanTwinError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
