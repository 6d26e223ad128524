"""Data class of a wavefront on a square grid over its pupil; checks its values."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.inputs.kinds import refuse_masked

from ..derived import key_of
from ..display.error_budget import ErrorBudget
from ..inputs.arguments import checked
from ..inputs.checks import check_positive, check_share
from ..inputs.wavelength import check_wavelength
from ..process.clock import clocked, stage
from ..pupils import Projected, Pupil, seen_along
from ..tracing.variants.causes import Variants
from .changes import Changes, changes_of, of_opd

NOT_IN_KEY = ("seconds", "varied", "budget")
SIGN_CONVENTION = "OPD is positive where light is delayed"


@checked
@dataclass(frozen=True, eq=False, repr=False)
class WavefrontMap:
    """Samples of a wavefront at the centres of square pixels, and how they were obtained.

    Attributes:
        opd: Optical path difference [m], positive where light is delayed, shape (n, n), axes [y, x]: rows along the
            pupil's second axis, columns along its first, both ascending, or along those of a pupil that faces along
            `direction`; NaN where `weight` is 0.
        weight: Amplitude transmission of each pixel, averaged over its area, shape (n, n).
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        intensity: Mean intensity in each pixel, shape (n, n). It exceeds `weight` squared where an edge or an
            apodisation crosses a pixel; None takes `weight` squared.
        radius: Radius of the unit disc of the Zernike polynomials [m]; None takes half of the map's width.
        pupil: The pupil, if the map belongs to one.
        direction: Direction in which the rays left the pupil, shape (3,); None means the pupil's normal.
        blocked: Share of the pupil's weight whose rays did not arrive behind the field.
        removed: Names of the terms that were removed.
        plan: How the rays were traced, if they were.
        seconds: Wall time by stage: see STAGES in clock.py.
        varied: Function that returns some of the rays, which are pixels, and how they change by each cause of an error
            (tracing/variants/causes.py), or None; the errors of all numbers follow from it.
        budget: Function that returns the error budget of the OPD [m], where no rays are known.

    Raises:
        TypeError: An argument of the wrong type.
        ValueError: Shapes disagree, the pixel is not positive, the pupil is empty, the OPD inside the pupil is not
            finite, a weight is negative, or the wavelength is outside 0.1 to 20 um.
    """

    opd: np.ndarray
    weight: np.ndarray
    pixel: float
    wavelength: float
    intensity: np.ndarray | None = None
    radius: float | None = None
    pupil: Pupil | None = None
    direction: np.ndarray | None = None
    blocked: float = 0.0
    removed: tuple[str, ...] = ()
    plan: Any = None
    seconds: dict[str, float] = field(default_factory=dict)
    varied: Callable[[], Variants | None] | None = None
    budget: Callable[[], ErrorBudget] | None = None

    @property
    def key(self) -> Hashable:
        """A key for caches that is equal for equal maps, however long they took."""
        return key_of([getattr(self, each.name) for each in fields(self) if each.name not in NOT_IN_KEY])

    def __post_init__(self):
        """Check the values and store read-only copies."""
        if not (self.pupil is None or isinstance(self.pupil, Pupil)):
            raise TypeError(f"pupil must be one of the pupils, or None, got {type(self.pupil).__name__}")
        for name in ("opd", "weight", "intensity"):
            refuse_masked(getattr(self, name), name)
        opd, weight = np.array(self.opd, dtype=np.float64), np.array(self.weight, dtype=np.float64)
        if opd.ndim != 2 or opd.shape[0] != opd.shape[1] or opd.shape != weight.shape:
            raise ValueError(
                f"opd and weight must be square and have the same shape, got {opd.shape} and {weight.shape}"
            )
        pixel = check_positive(self.pixel, "pixel", "m")
        if not np.isfinite(weight).all() or (weight < 0.0).any() or not weight.any():
            raise ValueError("weights must be finite, not negative and not all zero")
        lit = weight > 0.0
        if not np.isfinite(opd[lit]).all():
            raise ValueError(
                f"the wavefront must be finite in the pupil, got {(~np.isfinite(opd[lit])).sum()} bad samples"
            )
        opd[~lit] = np.nan
        radius = 0.5 * len(opd) * pixel if self.radius is None else check_positive(self.radius, "radius", "m")
        intensity = weight**2 if self.intensity is None else np.array(self.intensity, dtype=np.float64)
        if intensity.shape == weight.shape:
            intensity[~lit] = 0.0
        if (
            intensity.shape != weight.shape
            or not np.isfinite(intensity).all()
            or not (intensity >= weight**2 * (1.0 - 1e-9)).all()
        ):
            raise ValueError("the intensity must be finite, have the weights' shape and be nowhere below their square")
        check_share(self.blocked, "blocked")
        if self.direction is not None and not (np.shape(self.direction) == (3,) and np.isfinite(self.direction).all()):
            raise ValueError(f"the direction must be three finite numbers, got {self.direction!r}")
        for array in (opd, weight, intensity):
            array.setflags(write=False)
        checked = {"opd": opd, "weight": weight, "intensity": intensity, "pixel": pixel, "radius": radius}
        for name, value in {**checked, "wavelength": check_wavelength(self.wavelength)}.items():
            object.__setattr__(self, name, value)

    @property
    def sign_convention(self) -> str:
        """What a positive OPD means."""
        return SIGN_CONVENTION

    @cached_property
    def aperture(self) -> Pupil | Projected | None:
        """The pupil as it is seen along `direction`, on whose grid the map is."""
        return None if self.pupil is None else seen_along(self.pupil, self.direction)

    @property
    def coordinate(self) -> np.ndarray:
        """X of the columns and y of the rows from the pupil's centre [m], shape (n,)."""
        return self.pixel * (np.arange(len(self.opd)) - 0.5 * (len(self.opd) - 1))

    @property
    def power(self) -> float:
        """Sum of the intensity over the pixels."""
        return float(np.asarray(self.intensity).sum())

    @property
    def lit(self) -> np.ndarray:
        """Mask of the pixels inside the pupil (positive weight), shape (n, n)."""
        return self.weight > 0.0

    @cached_property
    def points(self) -> np.ndarray:
        """X and y of the pixels inside the pupil [m], shape (lit count, 2)."""
        rows, columns = np.nonzero(self.lit)
        return np.stack([self.coordinate[columns], self.coordinate[rows]], axis=1)

    @property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """OPD [m] of the pixels inside the pupil, and weights that sum to 1, each of shape (lit count,)."""
        weight = self.weight[self.lit]
        return self.opd[self.lit], weight / weight.sum()

    @cached_property
    def changes(self) -> Changes | None:
        """How the map changes by each cause of an error; None if that is not known. Computed when first read."""
        return changes_of(self)

    @cached_property
    def error(self) -> ErrorBudget:
        """Error of the OPD of a pixel from the mean [m], by cause and in "total"; empty if it is not known.

        It is the root mean square over some of the rays, and covers that of 95 pixels in 100. Some rays are traced
        again when it is first read; seconds["error"] is the time spent on that.
        """
        with clocked() as spent, stage("error"):
            if self.varied is None:
                found = ErrorBudget() if self.budget is None else ErrorBudget(self.budget())
            else:
                found = ErrorBudget() if self.changes is None else of_opd(self)
        self.seconds["error"] = spent["total"]
        return found

    @property
    def opd_error(self) -> float:
        """Total OPD error [m] of the budget; NaN if it is not known."""
        return self.error.get("total", float("nan"))
