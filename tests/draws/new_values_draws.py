"""Random pupils prepared for one field and asked for others on its nodes: instants of a flow, or its scaled values.

Each ratio is compared with that of the field's own plan.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aerokernels import Annulus, Disc, IndexField, Rectangle, prepare_strehl
from aerokernels.pupils import Pupil
from aerokernels.tracing.pupil.new_values import FollowedRun

SIZE = 20e-3  # the longest side of a field [m]
FIELDS = 3


@dataclass(frozen=True)
class Case:
    """A pupil, how it is prepared, and the values of its fields by number; 0 is the one it is prepared for."""

    kind: str
    make: Callable[[int], IndexField]
    pupil: Pupil
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Finding:
    """One field: whether it followed the known plan, and the difference of its ratio over the error told of both."""

    number: int
    follows: bool
    share: float


def draw(seed: int) -> Case:
    """Draw air of random waves, most of it in a window, in one of the geometries, and a pupil that looks through it."""
    rng = np.random.default_rng(seed)
    geometry = str(rng.choice(["volume", "axisymmetric", "planar"]))
    shape = tuple(rng.integers(24, 60, 3) if geometry == "volume" else rng.integers(40, 160, 2))
    spacing = np.full(len(shape), SIZE / max(shape))
    frequency = np.sqrt(sum(axis**2 for axis in np.meshgrid(*map(np.fft.fftfreq, shape), indexing="ij")))
    frequency.flat[0] = np.inf
    strength = frequency ** -rng.uniform(1.2, 3.6) * np.exp(-((frequency / rng.uniform(0.08, 0.3)) ** 2))
    strength.flat[0] = 0.0
    window = np.ones(shape)
    if rng.random() < 0.6:
        for axis, count in enumerate(shape):
            first = 0.5 if geometry == "axisymmetric" and axis == 0 else 0.0  # from the axis of symmetry outward
            along = np.sin(np.pi * np.linspace(first, 1.0, count)) ** 2
            window *= along.reshape([-1 if other == axis else 1 for other in range(len(shape))])
    peak, scales = 10.0 ** rng.uniform(-7.5, -5.0), bool(rng.integers(2))

    def make(number: int) -> IndexField:
        noise = np.random.default_rng([seed, 0 if scales else number]).normal(size=shape)
        air = np.fft.ifftn(np.fft.fftn(noise) * strength).real
        contrast = peak * window * air / air.std() * (1.0 + 0.02 * number * scales)
        origin = -0.5 * spacing * (np.array(shape) - 1)
        if geometry == "axisymmetric":
            origin[0] = 0.0
        return IndexField.from_samples(contrast, origin=origin, spacing=spacing, geometry=geometry)

    size = 0.5 * SIZE * rng.uniform(0.2, 0.6)
    place = (0.0, 0.0, -1.5 * SIZE), (*rng.normal(size=2) * rng.choice([0.0, 0.05, 0.2]), 1.0)
    pupils = Disc(size, *place), Annulus(size, 0.4 * size, *place), Rectangle(size, size, *place)
    pupil = pupils[rng.integers(3)]
    options = {
        "wavelength": float(rng.choice([532e-9, 1.06e-6])),
        "precision": str(rng.choice(["float32", "float64"])),
        "tolerance": float(10.0 ** rng.uniform(-4.0, -2.0)),
        "ray_count": 1 << 17,
        "allow_truncation": True,
    }
    kind = f"{geometry} {shape}, {type(pupil).__name__}, {'scaled' if scales else 'other'} values, {options}"
    return Case(kind, make, pupil, options)


def check(case: Case, **engine: str) -> list[Finding]:
    """Compare the ratios of a case's fields with those of their own plans, on an engine."""
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of air that ends at the box
        known = prepare_strehl(case.make(0), case.pupil, **case.options, **engine)
        for number in range(1, FIELDS + 1):
            seen = known.with_field(case.make(number))
            ratio, alone = seen(7), prepare_strehl(case.make(number), case.pupil, **case.options, **engine)(7)
            told = float(np.hypot(ratio.error["total"], alone.error["total"]))
            difference = abs(ratio.value - alone.value)
            share = difference / told if told > 0.0 else float(difference > 0.0)
            found.append(Finding(number, isinstance(seen.job.prepared, FollowedRun), share))
    return found
