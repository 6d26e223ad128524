"""Interferograms of a field in one arm of a Mach-Zehnder interferometer.

    I = (1 + V cos(2 pi (opd / wavelength + s / fringe_spacing + phase))) / 2,     s across the fringes

Reference: W. Merzkirch, Flow Visualization, 2nd ed. (Academic Press, 1987), section 3.2.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..display.shown import shown
from ..inputs.arguments import checked
from ..inputs.checks import warn_caller
from ..medium import IndexField
from .bench import Bench, light_of_source
from .line_of_sight import LineOfSight, check_exposure, check_turn, traced_light
from .picture import TracedPicture
from .picture_error import SomeLight, shared_attributes


@shown
@dataclass(frozen=True, eq=False, kw_only=True)
class Interferogram(TracedPicture):
    """An interferogram with the data that it was made from.

    Attributes:
        opd: optical path difference against the ambient medium [m], shape (ny, nx); NaN where no ray came through.
        wavelength: vacuum wavelength [m].
        fringe_spacing: distance between undisturbed fringes [m]; None for the infinite fringe.
        fringe_angle: direction across the undisturbed fringes, from right toward up [rad].
        phase: of the undisturbed fringes at the middle of the picture [waves].
        visibility: contrast of the fringes, 0 to 1.
    """

    opd: np.ndarray
    wavelength: float
    fringe_spacing: float | None
    fringe_angle: float
    phase: float
    visibility: float

    KIND: ClassVar[str] = "interferogram"
    MAPS: ClassVar[dict[str, tuple[str, str, str]]] = {
        "opd": ("pixel", "m", "optical path difference against the ambient medium")
    }
    NUMBERS: ClassVar[dict[str, str]] = {
        "wavelength_m": "wavelength",
        "fringe_spacing_m": "fringe_spacing",
        "fringe_angle_rad": "fringe_angle",
        "phase_waves": "phase",
        "visibility": "visibility",
    }


@checked
def interferogram(
    field: IndexField | LineOfSight,
    *,
    fringe_spacing: float | None = None,
    fringe_angle: float = 0.5 * math.pi,
    phase: float = 0.0,
    visibility: float = 1.0,
    exposure: float = 1.0,
    bench: Bench | None = None,
    **options: Any,
) -> Interferogram:
    """Make an interferogram of a field.

    Args:
        field: any field, of which a planar one needs `width` and a view along x; or light that was traced through one.
        fringe_spacing: distance between undisturbed fringes [m] (finite fringe); None for the infinite fringe.
        fringe_angle: direction across the undisturbed fringes, from the picture's right toward its up [rad].
        phase: of the undisturbed fringes at the middle of the picture [waves]; 0 is bright.
        visibility: contrast of the fringes, 0 to 1.
        exposure: brightness of a bright fringe, 1 for white.
        bench: the bench's optics: each point of its source makes its own fringes in the plane in focus; its sensor adds
            noise.
        **options: view, extent, pixel_count, rays_per_pixel, width, tolerance, wavelength, backend, device, precision:
            as in `line_of_sight`.

    Warns:
        UserWarning: in more than a hundredth of the picture fringes are narrower than two rays.

    Raises:
        ValueError: an argument is out of range, or the fringes are too fine for the pixels.
    """
    fringes = Fringes(fringe_spacing, fringe_angle, phase, visibility)
    check_exposure(exposure)
    shared: dict[str, Any] = {}
    if bench is None:
        traced = traced_light(field, options)
        light = fringes.light(traced)
    else:
        light, traced, known = light_of_source(field, bench, 0.0, lambda rays, point: fringes.light(rays), options)
        shared = {"bench": bench, "known": known, "is_same": len(bench.points()[1]) == 1}
    _warn_of_narrow(traced, fringes)
    return Interferogram(
        opd=traced.pixel_mean(traced.opd),
        wavelength=traced.wavelength,
        fringe_spacing=None if fringe_spacing is None else float(fringe_spacing),
        fringe_angle=float(fringe_angle),
        phase=float(phase),
        visibility=float(visibility),
        **shared_attributes(fringes, traced, light, exposure, **shared),
    )


@dataclass(frozen=True)
class Fringes:
    """Undisturbed fringes: the arguments of `interferogram` of the same names."""

    spacing: float | None = None
    angle: float = 0.5 * math.pi
    phase: float = 0.0
    visibility: float = 1.0

    def __post_init__(self) -> None:
        """Check the values."""
        if self.spacing is not None and not (np.isfinite(self.spacing) and self.spacing > 0.0):
            raise ValueError(f"fringe_spacing = {self.spacing}: give a positive length in metres, or None")
        check_turn("fringe_angle", self.angle)
        if not np.isfinite(self.phase):
            raise ValueError(f"phase = {self.phase}: give a finite number")
        if not 0.0 <= self.visibility <= 1.0:
            raise ValueError(f"visibility = {self.visibility}: give a fraction from 0 to 1")

    def light(self, traced: LineOfSight) -> np.ndarray:
        """Return the light of traced rays, a mean over each pixel, shape (ny, nx)."""
        return traced.pixel_mean(np.where(traced.through, self.of_rays(traced), 0.0))

    def light_of(self, some: SomeLight) -> np.ndarray:
        """Return the light of some pixels, shape (pixels,)."""
        return np.asarray(self.of_rays(some).mean(axis=1))

    def of_rays(self, traced: LineOfSight | SomeLight) -> np.ndarray:
        """Return the light of each ray, of the shape of `waves`; errors as there."""
        return np.asarray(0.5 * (1.0 + self.visibility * np.cos(2.0 * np.pi * self.waves(traced))))

    def waves(self, traced: LineOfSight | SomeLight) -> np.ndarray:
        """Return the phases of traced rays [waves], NaN where none came through; refuse fringes finer than pixels."""
        window = traced.window
        waves = traced.opd / traced.wavelength + self.phase
        if self.spacing is not None:
            if self.spacing < 2.0 * max(window.pitch):
                raise ValueError(
                    f"fringe_spacing = {self.spacing:g} m is less than two pixels of {max(window.pitch):g} m: "
                    "widen the fringes or raise pixel_count"
                )
            across, along = traced.ray_grid
            middle = (0.5 * (line[0] + line[-1]) for line in (window.horizontal, window.vertical))
            right, up = (place - at for place, at in zip((across, along), middle, strict=True))
            waves = waves + (right * math.cos(self.angle) + up * math.sin(self.angle)) / self.spacing
        return np.asarray(waves)


def _warn_of_narrow(traced: LineOfSight, fringes: Fringes) -> None:
    """Warn if fringes are narrower than two rays in over 1 % of the picture: a shock is a line of such places."""
    waves = np.where(traced.through, fringes.waves(traced), np.nan)
    narrow = np.zeros(waves.shape, bool)
    for axis in (0, 1):
        steps = np.abs(np.diff(waves, axis=axis)) > 0.5  # NaN at the edge of the body is none
        narrow |= np.pad(steps, [(0, int(axis == side)) for side in (0, 1)])
    share = float(narrow.sum() / max(int(np.isfinite(waves).sum()), 1))
    if share > 0.01:
        warn_caller(
            f"in {100.0 * share:.2g} % of the interferogram the phase changes by more than half a fringe from one ray "
            "to the next, so that its pattern there is not that of the fringes: raise pixel_count or rays_per_pixel, "
            "or take a smaller extent"
        )
