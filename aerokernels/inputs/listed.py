"""List names of a file in a message: there may be thousands, and each may have thousands of letters."""

from collections.abc import Iterable
from itertools import islice

MOST, LONGEST = 20, 60  # names, characters of each


def listed(names: Iterable[object], none: str = "nothing") -> str:
    """Return the first names, shortened, and how many more there are; `none` where there are none."""
    every = iter(names)
    first = [name if len(name) <= LONGEST else f"{name[:LONGEST]}..." for name in map(str, islice(every, MOST))]
    left = sum(1 for _ in every)
    return (", ".join(first) or none) + (f" and {left} more" if left else "")
