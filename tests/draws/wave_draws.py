"""Random views through shocks and turbulence, to test the verdict on the validity of ray optics.

Three kinds: "shock" (one to three oblique tanh layers of random strength, position, slope, curvature and thickness, in
a planar field), "turbulence" (a Kolmogorov spectrum between an outer scale as wide as the box and a smallest one, in a
volume) and "mixed" (both, in a volume). The disturbance fills a random part of the box, the rest is air at rest; the
fields fade out at both ends of that part, so that nothing is cut off. The phase over the pupil is random, from a
twentieth of a radian to five, and the contrast follows from it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.pupils import Annulus, Disc, Pupil, Rectangle
from aerokernels.wavefronts import wavefront
from aerokernels.waves import split_step, validity

from .closed_air import log_uniform

KINDS = ("shock", "turbulence", "mixed")
# Greatest number of nodes along z and across.
MOST_ALONG, MOST_ACROSS = 400, 257
VOLUME_ALONG, VOLUME_ACROSS = 96, 81
# Width of the box over the pupil's, and the part of the disturbed length over which it fades at either end.
REACH, FADE = 2.0, 0.15
# The greatest contrast: air of three times the density at sea level.
GREATEST_CONTRAST = 8e-4
# Rays are good if their Strehl ratio is within this of the wave's.
GOOD = 1e-2
# Pixels of the traced wavefront, and of the window of the wave that serves as the truth.
MAP_PIXELS, WAVE_PIXELS = 64, 160
# Width sqrt(wavelength distance) over the pupil's up to which light stays in the box.
NARROW = 0.12


@dataclass(frozen=True, eq=False)
class DrawnView:
    """A field, a pupil before it and a wavelength.

    Attributes:
        kind: Of KINDS.
        field: The refractive index.
        pupil: The pupil, which looks along z.
        wavelength: Vacuum wavelength [m].
        smallest: Half period of the finest turbulence, or the thickness of the thinnest layer [m].
        length: Length of the disturbed air [m].
    """

    kind: str
    field: IndexField
    pupil: Pupil
    wavelength: float
    smallest: float
    length: float


@dataclass(frozen=True)
class VerdictCheck:
    """A verdict and the truth.

    Attributes:
        by_rays: Strehl ratio of the traced wavefront.
        by_wave: Strehl ratio of the wave.
        wave_error: Error of the latter, from its steps and pixels.
        reported: Change of the Strehl ratio that the verdict reports.
        said_good: The verdict.
        limit: The change up to which rays are good.
        seconds: CPU time of the traced wavefront and of the verdict [s].
    """

    by_rays: float
    by_wave: float
    wave_error: float
    reported: float
    said_good: bool
    limit: float
    seconds: tuple[float, float]

    @property
    def is_good(self) -> bool:
        """Whether rays are good, according to the wave."""
        return abs(self.by_wave - self.by_rays) <= self.limit

    @property
    def right(self) -> bool:
        """Whether the verdict is right."""
        return self.said_good == self.is_good


def check_verdict(
    view: DrawnView, limit: float = GOOD, pixel_count: int = WAVE_PIXELS, map_pixels: int = MAP_PIXELS
) -> VerdictCheck:
    """Compare the verdict on a traced wavefront with a finely sampled wave."""
    from time import process_time

    begin = process_time()
    seen = wavefront(view.field, view.pupil, wavelength=view.wavelength, pixel_count=map_pixels)
    traced = process_time()
    verdict = validity(view.field, view.pupil, wavelength=view.wavelength, wavefront=seen, limit=limit)
    done = process_time()
    wider = truth_window(view) / REACH
    wave = split_step(
        view.field,
        view.pupil,
        wavelength=view.wavelength,
        pixel_count=int(wider * pixel_count),
        window=wider * REACH,
        tolerance=3e-4,
    )
    return VerdictCheck(
        by_rays=seen.strehl(),
        by_wave=wave.strehl(),
        wave_error=wave.strehl_error,
        reported=verdict.strehl_change,
        said_good=verdict.good,
        limit=limit,
        seconds=(traced - begin, done - traced),
    )


def truth_window(view: DrawnView) -> float:
    """Window of the true wave over the pupil: twice as wide as the box where light diffracts out of the box.

    Light that returns from beyond the sides changed the Strehl ratio by up to 0.006 with the box as the window.
    """
    reach, (_, high) = max(view.pupil.half_extent), view.field.box
    width = np.sqrt(view.wavelength * (high[2] - view.pupil.center[2])) / reach
    return REACH if width < NARROW else 2.0 * REACH


def draw_view(seed: int, kind: str | None = None) -> DrawnView:
    """Return the view of a seed, of the given kind or of the kind that the seed selects."""
    rng = np.random.default_rng([19, seed])
    kind = KINDS[seed % len(KINDS)] if kind is None else kind
    half = log_uniform(rng, 0.5e-3, 10e-3)
    wavelength = float(rng.choice([355e-9, 532e-9, 633e-9, 905e-9, 1064e-9, 1550e-9]))
    box = log_uniform(rng, 0.03, 1.5)
    length = box * rng.uniform(0.2, 1.0)
    start = rng.uniform(0.0, box - length)
    phase = log_uniform(rng, 0.05, 5.0)
    planar = kind == "shock"
    smallest = half * log_uniform(rng, 1.0 / 30.0, 1.0) if planar else half * log_uniform(rng, 0.12, 1.0)
    across = int(np.clip(np.ceil(4.0 * REACH * half / smallest), 24, MOST_ACROSS if planar else VOLUME_ACROSS))
    along = int(np.clip(np.ceil(2.0 * length / smallest), 32, MOST_ALONG if planar else VOLUME_ALONG))
    y = REACH * half * np.linspace(-1.0, 1.0, across)
    cell = length / (along - 1)
    # Air at rest on both sides: at least a few cells, so that there is room for the fade.
    before, after = (2 + int(np.ceil(rest / cell)) for rest in (start, box - length - start))
    z = cell * np.arange(before + along + after)
    inside = np.clip((z / cell - before) / (along - 1), 0.0, 1.0)
    envelope = _fade(inside)
    axes = (y, z) if planar else (y, y, z)
    shape = tuple(len(axis) for axis in axes)
    total = np.zeros(shape)
    if kind != "turbulence":
        total += _shocks(rng, axes, half, cell, length, cell * before, smallest)
    if kind != "shock":
        made = _turbulence(rng, axes, smallest)
        share = 1.0 if kind == "turbulence" else rng.uniform(0.2, 1.5) * max(float(np.std(total)), 1e-12)
        total += share * made / np.std(made)
    total *= envelope
    pupil = _pupil(rng, half)
    contrast = total * _scale(total, y, cell, pupil, phase * wavelength / (2.0 * np.pi))
    contrast *= min(1.0, GREATEST_CONTRAST / float(np.abs(contrast).max()))
    field = IndexField.from_samples(
        contrast,
        origin=tuple(axis[0] for axis in axes),
        spacing=tuple(axis[1] - axis[0] for axis in axes),
        geometry="planar" if planar else "volume",
        ambient_index=1.0 + 2.7e-4,
    )
    return DrawnView(kind, field, pupil, wavelength, smallest, length)


def _pupil(rng: np.random.Generator, half: float) -> Pupil:
    """A pupil just ahead of the box, with half width `half`."""
    kind, center = rng.integers(4), (0.0, 0.0, -1e-3)
    if kind == 0:
        return Rectangle(2.0 * half, 2.0 * half * rng.uniform(0.6, 1.0), center)
    if kind == 1:
        return Annulus(half, half * rng.uniform(0.2, 0.5), center)
    return Disc(half, center)


def _fade(place: np.ndarray) -> np.ndarray:
    """A smooth function that is 1 in the middle and 0 at places 0 and 1."""
    rise = np.clip(np.minimum(place, 1.0 - place) / FADE, 0.0, 1.0)
    return np.sin(0.5 * np.pi * rise) ** 2


def _shocks(rng, axes: tuple[Any, ...], half: float, cell: float, length: float, start: float, thinnest: float):
    """Oblique layers of contrast, of random strength; at least two cells thick."""
    y, z = axes[-2], axes[-1]
    total = np.zeros((len(y), len(z)))
    for _ in range(rng.integers(1, 4)):
        angle = rng.choice([-1.0, 1.0]) * log_uniform(rng, np.deg2rad(0.5), np.deg2rad(80.0))  # to the line of sight
        middle = start + length * rng.uniform(0.2, 0.8)
        offset = half * rng.uniform(-0.7, 0.7)
        curve = rng.uniform(-0.3, 0.3) / half
        across, along = np.cos(angle), np.sin(angle)
        thickness = max(thinnest * log_uniform(rng, 1.0, 3.0), 2.0 * cell * abs(along), 2.0 * (y[1] - y[0]) * across)
        height = y[:, None] - offset
        distance = across * height - along * (z - middle) - across * curve * height**2
        total += rng.uniform(-1.0, 1.0) * 0.5 * (1.0 + np.tanh(2.0 * distance / thickness))
    return total if len(axes) == 2 else np.broadcast_to(total, (len(axes[0]), *total.shape)).copy()


def _turbulence(rng, axes: tuple[Any, ...], smallest: float) -> np.ndarray:
    """Noise of the spectrum (K^2 + K_0^2)^(-11/6) exp(-(K / K_m)^2), K_m = pi / smallest; periodic."""
    shape = tuple(len(axis) for axis in axes)
    waves = [2.0 * np.pi * np.fft.fftfreq(len(axis), axis[1] - axis[0]) for axis in axes]
    square = sum(w**2 for w in np.meshgrid(*waves, indexing="ij", sparse=True))
    outer = 2.0 * np.pi / (axes[0][-1] - axes[0][0])
    spectrum = (square + outer**2) ** (-11.0 / 6.0) * np.exp(-square * (smallest / np.pi) ** 2)
    noise = np.fft.fftn(rng.standard_normal(shape))
    return np.asarray(np.fft.ifftn(noise * np.sqrt(spectrum)).real)


def _scale(contrast: np.ndarray, y: np.ndarray, cell: float, pupil: Pupil, opd_rms: float) -> float:
    """The factor that gives the OPD of straight lines this rms over the pupil [m], without piston."""
    path = cell * contrast.sum(axis=-1)
    path = path if path.ndim == 2 else np.broadcast_to(path, (len(y), len(y)))
    across, up = np.meshgrid(y, y, indexing="ij")
    lit = pupil.transmission(across.ravel(), up.ravel()) > 0.0
    return opd_rms / max(float(np.std(path.ravel()[lit])), 1e-300)
