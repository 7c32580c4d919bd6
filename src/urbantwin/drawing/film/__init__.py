"""Films of a motion: from above and from a street corner, drawn without a display."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.drawing.film.moving_pictures import (
        FilmPlan,
        film_colours,
        film_pictures,
        plan_film,
    )
    from urbantwin.drawing.film.video_file import check_video_file, write_video

__all__ = [
    "FilmPlan",
    "check_video_file",
    "film_colours",
    "film_pictures",
    "plan_film",
    "write_video",
]

names_on_demand(__name__)
