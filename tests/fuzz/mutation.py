"""One seed changed into one bad file, the same for the same number each time."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .bytes_mutation import BYTES
from .container_mutation import container_of
from .document_mutation import document_of
from .text_mutation import TEXT, is_text

#: Changes a seed. Takes the random numbers, the seed and another seed to splice with.
Mutator = Callable[[random.Random, bytes, bytes], bytes]


@dataclass(frozen=True)
class Mutation:
    """A bad file.

    Attributes:
        number: which one it is of its reader's.
        seed: which seed it was made of.
        how: the names of what was done.
        data: what the file holds.
    """

    number: int
    seed: int
    how: str
    data: bytes

    def __str__(self) -> str:
        return f"mutation {self.number} ({self.how} of seed {self.seed})"


def mutators_of(data: bytes) -> dict[str, Mutator]:
    """Return what can be done to a file like this: what knows its structure stands first."""
    return {
        **container_of(data, mutators_of),
        **document_of(data),
        **(TEXT if is_text(data) else {}),
        **BYTES,
    }


def mutation(name: str, number: int, seeds: Sequence[bytes]) -> Mutation:
    """Return the bad file of a number: mutators take turns, one to three at a time.

    Args:
        name: of the reader: other numbers for others.
        number: from 0.
        seeds: sound files.
    """
    rng = random.Random(f"{name} {number}")
    which = number % len(seeds)
    data = seeds[which]
    names = []
    for step in range(rng.choice([1, 1, 1, 2, 3])):
        mutators = mutators_of(data)
        ordered = list(mutators)
        turn = (number // len(seeds)) % len(ordered) if step == 0 else rng.randrange(len(ordered))
        names.append(ordered[turn])
        data = mutators[ordered[turn]](rng, data, rng.choice(seeds))
    return Mutation(number, which, ", ".join(names), data)
