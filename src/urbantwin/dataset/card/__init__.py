"""The card of a dataset: what it is, how it was made, what may be done with it, what it is not."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.dataset.card.page import CARD, PICTURE_OF_SPLIT, PICTURES
    from urbantwin.dataset.card.statistics import read_statistics
    from urbantwin.dataset.card.write import (
        carded_folders,
        renew_cards,
        renewed_folder,
        write_cards,
        write_index,
    )

__all__ = [
    "CARD",
    "PICTURES",
    "PICTURE_OF_SPLIT",
    "carded_folders",
    "read_statistics",
    "renew_cards",
    "renewed_folder",
    "write_cards",
    "write_index",
]

names_on_demand(__name__)
