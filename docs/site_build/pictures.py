"""Draw the README's pictures into ``docs/assets``: ``python docs/site_build/pictures.py``.

Three show the demo, which is run anew unless ``--demo`` names the folder of one. The fourth shows a
real frame of PandaSet beside our bodies along the same rays; its data are not in the repository
(``--real``), and where they are missing the picture stays as it is. `make docs` runs this.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import urbantwin as ut
from urbantwin.dataset.motion_interpolation import rows_at
from urbantwin.drawing import style
from urbantwin.drawing.film.from_corner import FromCorner
from urbantwin.drawing.film.signal_lamps import Lamps
from urbantwin.drawing.scene import Camera
from urbantwin.fidelity.histograms import full_scale
from urbantwin.geometry import Pose
from urbantwin.lidar import sensor
from urbantwin.taxonomy import BOX_SEMANTICS, GROUND_CLASSES, semantic_id

__all__ = ["draw_all"]

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "docs" / "assets"
REAL = ROOT.parent / "shared" / "data" / "recordings" / "pandaset-001" / "frame_ego.npz"

#: The moving picture: where from, how many frames, how many of them a second, pixels.
CORNER = Camera((-4.0, 4.0, 0.0), 58.0, azimuth_deg=-30.0, elevation_deg=30.0, field_deg=62.0)
FRAMES, SHOWN_HZ, MOVIE_SIZE = 32, 8, (720, 405)
#: The real frame, in the sensor's frame: where from, pixels of one side.
STREET = Camera((0.5, -13.5, -1.4), 21.0, azimuth_deg=110.0, elevation_deg=26.0, field_deg=56.0)
SIDE_SIZE = (600, 400)
#: Widest of the pictures that do not move, pixels.
WIDEST = 1200

#: A picture is drawn this many times finer, then averaged.
FINER = 2
#: Points nearer than this are so many fine pixels wide, metres.
WIDTHS = ((30.0, 4), (90.0, 3), (np.inf, 2))
#: Static kinds have quieter colours than in the taxonomy, so that road users stand out, 0..255.
GROUND, WALL, PLANT, THING = (118, 136, 158), (158, 134, 98), (70, 134, 90), (190, 186, 162)
#: A box with fewer points is not drawn.
FEWEST = 5
#: Pairs of corners, numbered as `corners_of` returns them.
EDGES = [(k, k ^ bit) for k in range(8) for bit in (1, 2, 4) if k < k ^ bit]


def draw_all(demo: Path, real: Path, out: Path) -> list[Path]:
    """Draw every picture that the inputs allow.

    Args:
        demo: the folder of `urbantwin demo`.
        real: PandaSet's frame; a message says so where it is missing.
        out: the folder of the pictures.
    """
    made = [draw_movie(demo, out / "demo.webp")]
    for source, name in (("scene", "twin"), ("range_image", "frame")):
        picture = Image.open(demo / "dataset" / "pictures" / f"{source}.png").convert("RGB")
        picture.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
        made.append(out / f"{name}.webp")
        picture.save(made[-1], quality=82, method=6)
    if real.is_file():
        made.append(draw_real_and_simulated(real, out / "real_and_simulated.webp"))
    else:
        print(f"real_and_simulated.webp stays as it is: no {real}", file=sys.stderr)
    return made


def draw_movie(demo: Path, path: Path) -> Path:
    """Draw the twin and its LiDAR frames from one place, parted by a line that moves."""
    twin, motion = ut.Twin.open(demo / "twin"), ut.Motion.open(demo / "motion")
    dataset = ut.open(demo / "dataset")
    width, height = MOVIE_SIZE
    corner, lamps = FromCorner(twin, motion, CORNER, MOVIE_SIZE), Lamps(motion)
    begin = busiest(dataset)
    numbers = range(begin, begin + FRAMES)
    pictures, shown = [], set[str]()
    for number in numbers:
        frame = dataset[number]
        time_s = frame.time_s
        scene = Image.fromarray(corner.picture(rows_at(motion, time_s), lamps, time_s, {}))
        points = frame.site_SE3_dataset.apply(frame.points[:, :3].astype(np.float64))
        classes = frame.boxes["class"].to_pylist()
        seen = np.flatnonzero(frame.boxes["num_points"].to_numpy() >= FEWEST)
        shown |= {classes[k] for k in seen}
        boxes = [
            (frame.site_SE3_dataset.apply(corners_of(frame.box_array[k])), classes[k]) for k in seen
        ]
        lidar = draw_points(
            View(CORNER, *MOVIE_SIZE), points, colours_of(frame.semantic, points[:, 2]), boxes
        )
        turn = 2 * np.pi * (number - begin) / FRAMES
        middle = round(width * (0.5 - 0.34 * np.cos(turn)))
        picture = scene.copy()
        picture.paste(lidar.crop((middle, 0, width, height)), (middle, 0))
        pen = ImageDraw.Draw(picture)
        pen.rectangle((middle - 1, 0, middle, height), fill=style.INK)
        write(pen, (middle - 12, 12), "twin", "ra")
        write(pen, (middle + 12, 12), f"LiDAR, {len(points):,} points", "la")
        pictures.append(picture)
    first, *others = (with_strip(picture, sorted_classes(shown)) for picture in pictures)
    first.save(
        path, save_all=True, append_images=others, duration=1000 // SHOWN_HZ, loop=0,
        quality=38, method=6, minimize_size=True,
    )  # fmt: skip
    return path


def busiest(dataset: ut.Dataset) -> int:
    """Return the first of those frames in a row in which most vehicles move."""
    boxes = dataset.boxes
    speed = np.hypot(boxes["vx"].to_numpy(), boxes["vy"].to_numpy())
    counts = (speed > 1.0) & (boxes["num_points"].to_numpy() >= FEWEST)
    counts &= np.array(boxes["class"].to_pylist()) != "pedestrian"
    frames = [frame["name"] for frame in dataset.manifest["frames"]]
    places = np.searchsorted(frames, np.array(boxes["frame"].to_pylist())[counts])
    moving = np.bincount(places, minlength=len(frames))
    return int(np.argmax(np.convolve(moving, np.ones(FRAMES), "valid")))


def draw_real_and_simulated(real: Path, path: Path) -> Path:
    """Draw a real frame, and beside it the same with our bodies along the same rays."""
    sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "benchmarks")]
    from pandaset_frame import pandaset_frame

    from objects_in_boxes.measure import compare_objects

    frame = pandaset_frame(real)
    assert frame.intensity is not None
    seen = compare_objects(
        frame, sensor("Pandar64"), scale=full_scale(float(frame.intensity.max()))
    )
    # Points of no compared object are the same on both sides.
    owned = {tuple(point) for one in seen for point in one.real.tolist()}
    rest = frame.points[[tuple(point) not in owned for point in frame.points.tolist()]]
    quiet = 0.8 * height_colours(rest)
    view = View(STREET, *SIDE_SIZE)
    width, height = SIDE_SIZE
    whole = Image.new("RGB", (2 * width + 4, height), style.FAINT)
    boxes = [(corners_of(one.mended_box), one.class_name) for one in seen]
    shown = sorted_classes(name for corners, name in boxes if view.holds(corners))
    for side, words in enumerate(("real: PandaSet, Pandar64", "simulated road users, same rays")):
        parts = [one.ours if side else one.real for one in seen]
        shaded = [
            shade(one.class_name, part, one.mended_box)
            for one, part in zip(seen, parts, strict=True)
        ]
        picture = draw_points(
            view, np.concatenate([rest, *parts]), np.concatenate([quiet, *shaded]), boxes
        )
        write(ImageDraw.Draw(picture), (12, 12), words, "la")
        whole.paste(picture, (side * (width + 4), 0))
    source = "PandaSet by Hesai and Scale AI, CC BY 4.0; right: its road users replaced"
    with_strip(whole, shown, source).save(path, quality=82, method=6)
    return path


@dataclass(frozen=True)
class View:
    """A camera and the size of its picture.

    Attributes:
        camera: from where.
        width, height: of the finished picture, pixels.
    """

    camera: Camera
    width: int
    height: int

    def project(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return fine pixels (N, 2) of points (N, 3), and how far ahead they are (N,), metres."""
        forward = np.asarray(self.camera.target, np.float64) - self.camera.place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        away = points - self.camera.place
        ahead = away @ forward
        scale = FINER * self.width / 2 / np.tan(np.radians(self.camera.field_deg) / 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = FINER * self.width / 2 + scale * (away @ right) / ahead
            y = FINER * self.height / 2 - scale * (away @ np.cross(right, forward)) / ahead
        return np.column_stack([x, y]), ahead

    def holds(self, points: NDArray[np.float64]) -> bool:
        """Whether all points (N, 3) are in the picture."""
        places, ahead = self.project(points)
        size = FINER * np.array([self.width, self.height])
        return bool(((ahead > 1.0)[:, None] & (places >= 0) & (places < size)).all())


def draw_points(
    view: View,
    points: NDArray[np.float64],
    colours: NDArray[np.float64],
    boxes: Iterable[tuple[NDArray[np.float64], str]],
) -> Image.Image:
    """Draw points (N, 3) in their colours (N, 3), 0..255, and boxes (corners (8, 3), class)."""
    high, wide = view.height * FINER, view.width * FINER
    pixels = np.asarray(Image.new("RGB", (wide, high), style.PAPER)).copy()
    places, ahead = view.project(points)
    order = np.argsort(-ahead)
    order = order[ahead[order] > 1.0]
    far = ahead[order]
    columns, rows = np.floor(places[order]).astype(np.int64).T
    faded = np.clip(1.15 - far / 400.0, 0.65, 1.0)[:, None] * colours[order]
    nearest = 0.0
    sizes = np.zeros(len(order), np.int64)
    for farthest, size in WIDTHS:
        sizes[(far >= nearest) & (far < farthest)] = size
        nearest = farthest
    for down, across in np.ndindex(sizes.max(initial=0), sizes.max(initial=0)):
        row, column = rows + down, columns + across
        inside = (sizes > max(down, across)) & (row >= 0) & (row < high)
        inside &= (column >= 0) & (column < wide)
        pixels[row[inside], column[inside]] = faded[inside].astype(np.uint8)
    picture = Image.fromarray(pixels)
    pen = ImageDraw.Draw(picture)
    for corners, name in boxes:
        ends, distances = view.project(corners)
        if (distances > 1.0).all():
            for first, second in EDGES:
                pen.line([*ends[first], *ends[second]], fill=class_colour(name), width=FINER)
    return picture.resize((view.width, view.height), Image.Resampling.BOX)


def corners_of(box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (8, 3) of a box: x, y, z, length, width, height, yaw."""
    halves = np.array([[(-0.5, 0.5)[k >> bit & 1] for bit in range(3)] for k in range(8)])
    return Pose.from_ypr(box[:3], box[6], 0.0, 0.0).apply(halves * box[3:6])


def colours_of(semantic: NDArray[np.integer], height_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return colours (N, 3) of points: road users by class, all else by kind and height."""
    table = np.tile(np.array(THING, np.float64), (256, 1))
    kinds = {
        GROUND: GROUND_CLASSES,
        WALL: ("building", "fence", "other-structure"),
        PLANT: ("vegetation", "trunk"),
    }
    for colour, names in kinds.items():
        for name in names:
            table[semantic_id(name)] = colour
    users = {BOX_SEMANTICS[name] for name in ("car", "truck", "bus", "motorcycle", "bicycle")}
    users |= {BOX_SEMANTICS[name] for name in ("pedestrian", "tram")}
    numbers = [semantic_id(name) for name in users]
    table[numbers] = 255 * style.class_colours(numbers)
    light = np.where(np.isin(semantic, numbers), 1.0, np.clip(0.75 + 0.03 * height_m, 0.7, 1.15))
    return np.clip(table[semantic] * light[:, None], 0, 255)


def height_colours(points: NDArray[np.float64], cell_m: float = 2.0) -> NDArray[np.float64]:
    """Return colours (N, 3) of points without classes, by height above the lowest of a cell."""
    _, cell = np.unique(np.floor(points[:, :2] / cell_m), axis=0, return_inverse=True)
    lowest = np.full(cell.max() + 1, np.inf)
    np.minimum.at(lowest, cell.ravel(), points[:, 2])
    height = points[:, 2] - lowest[cell.ravel()]
    share = np.clip(height / 8.0, 0, 1)[:, None]
    raised = (1 - share) * np.array(PLANT) + share * np.array(THING)
    return np.where(height[:, None] < 0.25, np.array(GROUND), raised)


def shade(name: str, points: NDArray[np.float64], box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the colour of a class for points (N, 3), brighter towards the top of the box."""
    share = (points[:, 2] - box[2]) / box[5]
    light = np.clip(0.85 + 0.5 * share, 0.5, 1.2)
    return np.clip(light[:, None] * np.array(class_colour(name)), 0, 255)


def class_colour(name: str) -> tuple[int, int, int]:
    """Return the colour of a class of road users, 0..255."""
    red, green, blue = (int(255 * value + 0.5) for value in style.actor_colour(name))
    return red, green, blue


def sorted_classes(names: Iterable[str]) -> list[str]:
    """Return classes, each once, in the taxonomy's order; one of several that look the same."""
    present = set(names)
    by_colour = {class_colour(name): name for name in reversed(BOX_SEMANTICS) if name in present}
    return [name for name in BOX_SEMANTICS if name in by_colour.values()]


def with_strip(
    picture: Image.Image, classes: Iterable[str], source: str = "© OpenStreetMap contributors"
) -> Image.Image:
    """Return the picture with a legend of classes and its source below."""
    whole = Image.new("RGB", (picture.width, picture.height + 30), style.PAPER)
    whole.paste(picture)
    pen, x, y = ImageDraw.Draw(whole), 12.0, picture.height + 15
    for name in classes:
        pen.rectangle((x, y - 5, x + 10, y + 5), fill=class_colour(name))
        pen.text((x + 16, y), name, font=font(13), fill=style.INK, anchor="lm")
        x += 34 + pen.textlength(name, font=font(13))
    pen.text((picture.width - 10, y), source, font=font(11), fill=style.MUTED, anchor="rm")
    return whole


def write(pen: ImageDraw.ImageDraw, place: tuple[int, int], words: str, anchor: str) -> None:
    """Write words on a dark ground of their own."""
    left, top, right, bottom = pen.textbbox(place, words, font=font(15), anchor=anchor)
    pen.rounded_rectangle((left - 6, top - 4, right + 6, bottom + 4), 4, fill=style.PAPER)
    pen.text(place, words, font=font(15), fill=style.INK, anchor=anchor)


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """Return the font that matplotlib carries, so that every machine draws the same."""
    return ImageFont.truetype(
        str(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size
    )


def main() -> None:
    """Read the options, draw the pictures, print their sizes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=ASSETS)
    parser.add_argument("--demo", type=Path, help="what `urbantwin demo` wrote")
    parser.add_argument("--real", type=Path, default=REAL, help="PandaSet's frame_ego.npz")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        try:
            demo = options.demo or ut.demo(Path(scratch) / "demo").folder
            for path in draw_all(demo, options.real, options.out):
                print(f"{path}: {path.stat().st_size / 1000:.0f} kB")
        except ut.UrbanTwinError as error:
            sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
