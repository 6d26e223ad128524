"""Propagate a wave through a field by alternating steps of free space and phase: rays with diffraction.

A step is half a step of free space, by the angular spectrum, the phase of the contrast integrated along straight lines,
and half a step of free space (J. A. Fleck, J. R. Morris, M. D. Feit, Appl. Phys. 10 (1976) 129). The splitting error is
of second order in the step. Layers are sampled once: half as many steps cost only their transforms.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_choice, check_count, check_positive
from ..inputs.kinds import wrong_kind
from ..medium import IndexField
from ..process.clock import clocked, stage
from ..pupils import Pupil
from ..wavefronts import Wavefront
from ..wavefronts.changes import of_pixels
from ..wavefronts.pixels import LEAST_COVER
from .layers import FEWEST_STEPS, check_memory, layer_count, mean_layers, path_range
from .wave import Wave, propagated, transfer_exponent, warn_of_wrapping

# Fewest pixels along a side of a window.
FEWEST_PIXELS = 8
PRECISIONS = {"float64": np.complex128, "float32": np.complex64}


@checked
def split_step(
    field: IndexField,
    light: Pupil | Wave,
    *,
    wavelength: float | None = None,
    pixel_count: int = 256,
    window: float = 2.0,
    tolerance: float = 1e-3,
    step_count: int | None = None,
    paraxial: bool = False,
    precision: str = "float64",
) -> Wave:
    """Propagate a wave through a field: its Strehl ratio, focus and shadow without the approximation of rays.

    Args:
        field: The refractive index.
        light: A pupil, which a plane wave leaves along its normal, or any Wave, of which only amplitude, pixel,
            wavelength, centre and normal are used.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm if it has none. A Wave has its own.
        pixel_count: Pixels along a side of the square window, for a pupil.
        window: Width of the window over the width of the pupil. The window is periodic, so it must hold the light that
            diffracts out of the pupil.
        tolerance: Requested error of the amplitude due to the steps, rms over the rms amplitude.
        step_count: Number of steps; None takes as many as the tolerance needs.
        paraxial: Whether to use the paraxial equation for free space.
        precision: "float64" or "float32" for the transforms. In both cases the plane wave's phase is removed and the
            phase of a step is computed in float64.

    Returns:
        The Wave on the plane where the box ends, along the normal. Light that meets a body is lost, and lowers
        `strehl`; light that starts inside a body begins where it leaves the body.

    Warns:
        WrappedWaveWarning: Light leaves the window without the field's help, and comes back on its other side.

    Raises:
        TypeError: `field` or `light` is of the wrong type.
        ValueError: The wave does not meet the field, a number is out of range, or the window needs too much memory.
    """
    if not isinstance(field, IndexField):
        raise wrong_kind(field, "field", "an IndexField")
    if isinstance(light, Pupil):
        check_memory(FEWEST_STEPS, pixel_count**2)
        wave = plane_wave(light, field.wavelength_for(wavelength), pixel_count, window, field.ambient_index)
    elif isinstance(light, Wave):
        if wavelength is not None and wavelength != light.wavelength:
            raise ValueError(f"wavelength {wavelength!r} is not that of the Wave, {light.wavelength!r}: leave it out")
        field.wavelength_for(light.wavelength)
        wave = replace(light, ambient_index=field.ambient_index, incident=None)
    else:
        raise TypeError(f"light must be a pupil or a Wave, got {type(light).__name__}")
    check_positive(tolerance, "tolerance")
    if step_count is not None:
        check_count(step_count, "step_count")
    check_choice(precision, "precision", PRECISIONS)
    with clocked() as seconds:
        with stage("plan"):
            begin, end = path_range(field, wave)
            count = layer_count(field, end - begin, step_count)
            check_memory(count, wave.amplitude.size)
            sampled = mean_layers(field, wave, begin, end, count)
        warn_of_wrapping(wave, end)
        with stage("kernel"):
            layers = Layers(*sampled, end - begin, paraxial, PRECISIONS[precision])
            start = propagated(wave, begin, paraxial)
            result, coarse, steps, error = _refined(layers, start, tolerance, step_count)
            sparse = every_second_pixel(light, wave, window)
            strehl_error, path = float("nan"), sampled[0].sum(axis=0)
            if coarse is not None and sparse is not None:
                rough = propagated(sparse, begin, paraxial)
                fine, fewer, larger = (
                    replace(one, amplitude=amplitude).strehl()
                    for one, amplitude in (
                        (start, result),
                        (start, coarse),
                        (rough, layers.every_second().through(rough, steps)),
                    )
                )
                # The error due to the steps is estimated as in `_refined`. The order in the pixels is not known at an
                # edge: the whole difference counts. It may vanish by chance.
                strehl_error = abs(fine - fewer) / _gain(steps) + abs(fine - larger)
                if isinstance(light, Pupil):
                    strehl_error += _pixels_error(light, wave, path)
            if sparse is not None:
                # The order in the layers is not known where a face of the box is slanted: the whole difference counts.
                fewer_layers = mean_layers(field, sparse, begin, end, max(count // 2, 1), cells_apart=2.0)
                of_amplitude, of_strehl = _changes(sparse, path[every_second(path.shape)], fewer_layers[0].sum(axis=0))
                error, strehl_error = error + of_amplitude, strehl_error + of_strehl
    return replace(
        start,
        amplitude=result,
        center=wave.center + end * wave.normal,
        incident=wave.incident,
        error=error,
        strehl_error=strehl_error,
        step_count=steps,
        seconds=seconds,
    )


def plane_wave(pupil: Pupil, wavelength: float, pixel_count: int, window: float, ambient_index: float) -> Wave:
    """Return the plane wave behind a pupil, along its normal."""
    check_count(pixel_count, "pixel_count", FEWEST_PIXELS)
    if not (np.isfinite(window) and window >= 1.0):
        raise ValueError(f"window must be at least 1, the pupil's own width, got {window!r}")
    half = max(pupil.half_extent) * window
    pixel = 2.0 * half / pixel_count
    edges = pixel * (np.arange(pixel_count + 1) - pixel_count // 2 - 0.5)
    amplitude = pupil.coverage(edges, edges)
    amplitude[amplitude < LEAST_COVER * amplitude.max()] = 0.0
    return Wave(amplitude, pixel, wavelength, pupil.center, pupil.normal, ambient_index)


def every_second(shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Return slices of every second pixel of a window, the middle one among them."""
    return tuple(slice(count // 2 % 2, None, 2) for count in shape)


def every_second_pixel(light: Pupil | Wave, wave: Wave, window: float) -> Wave | None:
    """Return the same light on pixels of twice the side, centred on pixels of the wave; None if there are too few."""
    amplitude = wave.amplitude[every_second(wave.amplitude.shape)]
    if isinstance(light, Wave):
        return replace(wave, amplitude=amplitude, pixel=2.0 * wave.pixel, incident=None) if amplitude.any() else None
    count = len(amplitude)
    if count < FEWEST_PIXELS:
        return None
    return plane_wave(light, wave.wavelength, count, 2.0 * window * count / len(wave.amplitude), wave.ambient_index)


def _refined(
    layers: "Layers", start: Wave, tolerance: float, step_count: int | None
) -> tuple[np.ndarray, np.ndarray | None, int, float]:
    """Double the steps until the error is within the tolerance, or there is one per layer.

    Return the amplitude, that of half as many steps (None if their number is odd), the number of steps, and the error.
    """
    steps = step_count or FEWEST_STEPS
    coarse = None if steps % 2 else layers.through(start, steps // 2)
    fine = layers.through(start, steps)
    while coarse is not None:
        error = float(np.linalg.norm(fine - coarse)) / _gain(steps) / float(np.linalg.norm(start.amplitude))
        if step_count is not None or not error > tolerance or steps >= len(layers.paths):
            return fine, coarse, steps, error
        steps *= 2
        coarse, fine = fine, layers.through(start, steps)
    return fine, None, steps, float("nan")


def _gain(steps: int) -> float:
    """Return the quotient of the difference from half as many steps and the error.

    It is 3 for results of second order. One step may be too thick for this order: then the whole difference counts.
    """
    return 3.0 if steps > FEWEST_STEPS else 1.0


def _pixels_error(pupil: Pupil, wave: Wave, path: np.ndarray) -> float:
    """Return the error of a Strehl ratio due to the pixels, by that of the paths straight through the field [m]."""
    weight = wave.amplitude.real
    lit = weight > 0.0
    place = np.argwhere(lit) - np.array(weight.shape) // 2  # from the pixel whose middle is the pupil's centre
    reach = int(np.abs(place).max())
    maps = []
    for values in (path, weight):
        square = np.zeros((2 * reach + 1, 2 * reach + 1))
        square[tuple((place + reach).T)] = values[lit]
        maps.append(square)
    return float(of_pixels(Wavefront(maps[0], maps[1], wave.pixel, wave.wavelength, pupil=pupil), Wavefront.strehl))


def _changes(light: Wave, path: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Return how far two screens [m] differ in their amplitudes, rms over the rms amplitude, and Strehl ratios."""
    wave_number = 2.0 * np.pi / light.wavelength
    one, two = (light.amplitude * np.exp(1j * wave_number * own.astype(np.float64)) for own in (path, other))
    of_amplitude = float(np.linalg.norm(one - two) / np.linalg.norm(light.amplitude))
    return of_amplitude, abs(replace(light, amplitude=one).strehl() - replace(light, amplitude=two).strehl())


@dataclass(frozen=True, eq=False)
class Layers:
    """Layers of a field with free space between them."""

    paths: np.ndarray  # optical paths [m], shape (count, rows, columns)
    opaque: np.ndarray | None  # where light ends, of the same shape; None for nowhere
    length: float  # of all layers [m]
    paraxial: bool
    kind: type = np.complex64  # of the amplitude

    def every_second(self) -> "Layers":
        """Return the layers at every second pixel."""
        kept = every_second(self.paths.shape[1:])
        opaque = None if self.opaque is None else self.opaque[:, *kept]
        return replace(self, paths=self.paths[:, *kept], opaque=opaque)

    def through(self, wave: Wave, steps: int) -> np.ndarray:
        """Return the amplitude after all layers in so many steps; adjacent half steps of free space are merged."""
        from scipy.fft import fft2, ifft2

        step, each = self.length / steps, len(self.paths) // steps
        shape = wave.amplitude.shape
        exponent = transfer_exponent(shape, wave.pixel, wave.wavelength, wave.ambient_index, self.paraxial)
        half: np.ndarray = np.exp(0.5 * step * exponent).astype(self.kind)
        whole: np.ndarray = np.exp(step * exponent).astype(self.kind)
        spectrum = fft2(wave.amplitude.astype(self.kind))
        spectrum *= half
        for number in range(steps):
            part = slice(number * each, (number + 1) * each)
            amplitude = ifft2(spectrum)
            amplitude *= self._phase_factor(part, 2.0 * np.pi / wave.wavelength)
            if self.opaque is not None:
                amplitude[self.opaque[part].any(axis=0)] = 0.0
            spectrum = fft2(amplitude)
            spectrum *= half if number == steps - 1 else whole
        return np.asarray(ifft2(spectrum)).astype(np.complex128)

    def _phase_factor(self, part: slice, wave_number: float) -> np.ndarray:
        """Return exp(i k p) of the summed path p of some layers for a wave number k [1/m]."""
        single = self.kind is np.complex64
        phase = wave_number * self.paths[part].sum(axis=0, dtype=np.float64)
        # In single precision sine and cosine are ten times as fast, once whole turns are removed in double precision.
        phase -= 2.0 * np.pi * np.round(phase / (2.0 * np.pi))
        phase = np.asarray(phase, dtype=np.float32 if single else np.float64)
        return np.asarray(np.cos(phase) + np.asarray(1j, dtype=self.kind) * np.sin(phase))
