"""Slabs of a field with a body, on which light ends, and the body's shadow on a window.

There is no air inside a body: light that starts inside it begins where it leaves the body, as rays do, and other light
ends on it. The rest diffracts at the body's rim: little if its Fresnel number is large.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..pupils import Pupil
from ..tracing.lines import meets_wall
from .diffraction import Window
from .layers import mean_layers
from .slabs import FINEST, LookingAlong, Slabs, without_piston
from .wave import Wave

# Lines along a side of the pupil that test whether a body is near; how far beside the pupil they reach, in widths
# sqrt(wavelength distance) of a knife edge's fringes; results cached on a field.
LINES, FRINGES, KEPT = 24, 4.0, 8


class SlabsPastBody(Slabs):
    """Slabs of a field with a body: sums of layers sampled at the window's own points."""

    most_pixels = 96

    def __init__(self, field: IndexField, look: LookingAlong, begin: float, end: float, wavelength: float):
        """Store the arguments; sampling is deferred."""
        self._field, self._look, self._wavelength = field, look, wavelength
        self.first, self.last = begin, end
        self._sampled: dict[tuple[bytes, bytes], tuple[np.ndarray, np.ndarray]] = {}

    def paths(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        """See `Slabs.paths`. In the shadow a slab continues the path from beside it, so that the rim makes no slope."""
        path, opaque = self._layers(x, y)
        path = path.reshape(count, -1, *path.shape[1:]).sum(axis=1, dtype=np.float64)
        dark = opaque.any(axis=0)
        if dark.any() and not dark.all():
            from scipy.ndimage import distance_transform_edt

            row, column = distance_transform_edt(dark, return_distances=False, return_indices=True)
            path = path[:, row, column]
        return without_piston(path)

    def opaque(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray | None:
        """See `Slabs.opaque`."""
        _, opaque = self._layers(x, y)
        return np.asarray(opaque.reshape(count, -1, *opaque.shape[1:]).any(axis=1))

    def _layers(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return paths [m] and opaque masks of FINEST slabs at evenly spaced points."""
        key = np.asarray(x).tobytes(), np.asarray(y).tobytes()
        if key not in self._sampled:
            look = self._look
            middle = x[len(x) // 2] * look.axes[0] + y[len(y) // 2] * look.axes[1]
            pixel = float(y[1] - y[0])
            wave = Wave(np.ones((len(y), len(x))), pixel, self._wavelength, look.center + middle, look.normal)
            path, opaque = mean_layers(self._field, wave, self.first, self.last, FINEST)
            self._sampled = {key: (path, np.zeros(path.shape, dtype=bool) if opaque is None else opaque)}
        return self._sampled[key]


@dataclass(frozen=True)
class Shadow:
    """The share of a pupil's light that a body blocks.

    Attributes:
        blocked: Share of the light that ends on it.
        fresnel_number: Fresnel number of the light that passes: the squared radius of a disc of its area, over
            wavelength times the distance from the first rim to the end of the box; infinite if no body is near.
    """

    blocked: float = 0.0
    fresnel_number: float = float("inf")


def shadow_of(slabs: Slabs, window: Window, wavelength: float, end: float) -> tuple[Shadow, np.ndarray]:
    """Return the shadow on a window's light that leaves the box at a distance `end` [m], and the light that passes.

    The latter is the amplitude of the light whose rays pass the body, float32, of the window's shape.

    Raises:
        ValueError: No light passes the body.
    """
    opaque = slabs.opaque(window.x, window.y, FINEST)
    if opaque is None:
        return Shadow(), window.amplitude
    light = np.where(opaque.any(axis=0), np.float32(0.0), window.amplitude)
    if not light.any():
        raise ValueError("the body blocks all of the pupil's light: move the pupil, or turn its normal")
    if not opaque.any():
        return Shadow(), light
    first = int(np.argmax(opaque.any(axis=(1, 2))))
    distance = end - (slabs.first + first * (slabs.last - slabs.first) / len(opaque))
    area = float(light.sum()) * window.pixel * window.width
    blocked = max(1.0 - float((light**2).sum() / (window.amplitude**2).sum()), 0.0)
    return Shadow(blocked, area / (math.pi * wavelength * distance)), light


def is_clear(field: IndexField, pupil: Pupil, look: np.ndarray, wavelength: float) -> bool:
    """Return whether a field's body is far from a pupil's light, by straight lines through and beside the pupil."""
    if field.body is None:
        return True
    return _is_clear(field, pupil, look, wavelength)


def fringes(field: IndexField, wavelength: float) -> float:
    """Return how far from a rim light may diffract within the field's box [m]."""
    low, high = field.box
    size = np.linalg.norm(np.where(np.isfinite(high - low), high - low, 0.0))
    return FRINGES * math.sqrt(wavelength * float(size))


@cached_on("field", KEPT)
def _is_clear(field: IndexField, pupil: Pupil, look: np.ndarray, wavelength: float) -> bool:
    first, second = pupil.axes
    x, y = (half + fringes(field, wavelength) for half in pupil.half_extent)
    across, up = (axis.ravel() for axis in np.meshgrid(np.linspace(-x, x, LINES), np.linspace(-y, y, LINES)))
    start = pupil.center + across[:, None] * first + up[:, None] * second
    return not meets_wall(field, start, np.broadcast_to(look, start.shape).copy()).any()
