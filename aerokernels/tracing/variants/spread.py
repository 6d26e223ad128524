"""The error of a number by each cause: the number computed again where rays change, and what it changes by.

The error by a change of the rays is the number's change, and what a sample of rays leaves unsure of it: one eighth of
the rays is changed at a time, and eight times the number's change is a sample. Of changes to what is right, such as
those by the source of a resampled field, that is the standard error of the samples' mean. Changes that are only like
those to what is right, such as those by the next order of interpolation, may leave the number as it is by chance:
there it is the samples' standard deviation. Of draws the error is the root mean square of the number's change by each
of them. What each ray has of its own, as the pixels of a picture, has the root mean square over rays, all or those
about it. Everything times FACTOR; causes add as independent.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...display.quantities import ErrorBudget, combine
from .causes import BLOCKS, Variants
from .rays import Cause, Rays

FACTOR = 2.0
# What rays bring -> a number, or an array of them.
Number = Callable[[Rays], Any]


def spread(number: Number, base: Rays, cause: Cause) -> np.ndarray:
    """Return the error of a number, or of each in an array, by one cause."""
    plain, count = np.asarray(number(base)), len(base.opd)
    block = np.arange(count) * BLOCKS // max(count, 1)
    total = np.zeros(plain.shape)
    for change in filter(_differs, (*cause.known, *cause.like)):
        total += np.square(number(base + change) - plain)
        centred = change.lifted(-change.opd.mean())
        samples = np.array([BLOCKS * (number(base + centred * (block == part)) - plain) for part in range(BLOCKS)])
        total += samples.var(axis=0) / (BLOCKS - 1 if change in cause.known else 1)
    for draw in cause.draws:
        total += np.square(number(base + draw) - plain) / len(cause.draws)
    return np.asarray(FACTOR * np.sqrt(total))


def of_each(pick: Number, found: Variants, near: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return the error by cause of what each ray has of its own.

    Args:
        pick: Returns it for changes of the rays, shape (n, ...), 0 for none; n pixels may have several rays each.
        found: The rays and their changes.
        near: Rays about each ray, or pixels about each pixel, by which its error is found, shape (m, k); None for one
            error of all rays.
    """
    everywhere = np.arange(len(found.base.opd))[None] if near is None else near

    def square(change: Rays) -> np.ndarray:
        return np.asarray(np.square(pick(change))[everywhere].mean(axis=1))

    errors = {}
    for name, cause in found.causes.items():
        total = square(Rays.still(len(found.base.opd))) + sum(map(square, (*cause.known, *cause.like)))
        total = total + sum(map(square, cause.draws)) / max(len(cause.draws), 1)
        errors[name] = FACTOR * np.sqrt(total)
    return errors


def of_a_ray(pick: Number, found: Variants, unit: str = "", others: Mapping[str, Number] | None = None) -> ErrorBudget:
    """Return the error budget of what each ray has of its own: the same for all of them.

    Args:
        pick: As for `of_each`.
        found: The rays and their changes.
        unit: Unit of the errors.
        others: What is taken in place of `pick`, by cause.
    """
    picks = {name: (others or {}).get(name, pick) for name in found.causes}
    errors = {
        name: of_each(one, replace(found, causes={name: found.causes[name]}))[name] for name, one in picks.items()
    }
    return combine({name: float(error[0]) for name, error in errors.items()}, unit)


def _differs(change: Rays) -> bool:
    return bool(np.any(change.opd) or np.any(change.direction) or np.any(change.position))


def errors(number: Number, found: Variants) -> dict[str, np.ndarray]:
    """Return the error of a number, or of each in an array, by cause."""
    return {name: spread(number, found.base, cause) for name, cause in found.causes.items()}


def budget(number: Number, found: Variants, unit: str = "", **others: float) -> ErrorBudget:
    """Return the error budget of one number; `others` are errors by causes that no ray shows, such as "sampling"."""
    return combine({name: float(error) for name, error in errors(number, found).items()} | others, unit)
