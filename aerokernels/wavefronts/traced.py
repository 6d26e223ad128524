"""Trace the wavefront of a field over a pupil, with one ray from the centre of each pixel."""

from dataclasses import replace
from functools import partial
from typing import Any, Unpack

import numpy as np

from ..flow import DensityField
from ..inputs.arguments import Numbers, checked
from ..inputs.kinds import wrong_kind
from ..medium import IndexField
from ..pupils import Pupil, as_unit_vector, seen_along
from ..rays import RayBundle
from ..tracing.plan import TraceOptions, complete
from ..tracing.pupil.air import pupil_air
from ..tracing.stop import plane_beyond
from ..tracing.trace import trace
from .arithmetic import WavefrontComparison
from .pixels import pupil_grid
from .result import Wavefront


@checked
def wavefront(
    field: IndexField,
    pupil: Pupil,
    *,
    wavelength: float | None = None,
    direction: Numbers | None = None,
    pixel_count: int | None = None,
    **options: Unpack[TraceOptions],
) -> Wavefront:
    """Trace the optical path difference over a pupil, as a map.

    Rays leave the pupil along its normal (or `direction`) and stop on a plane across that line, beyond the field's box:
    by reciprocity this is the wavefront from a distant point on the line. The map is across the line: of a pupil seen
    askew it is the projection.

    Args:
        field: The refractive index.
        pupil: The pupil; it looks along its normal.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm where it has none.
        direction: Look direction, if not along the pupil's normal.
        pixel_count: Pixels along a side of the square map, the smallest that holds the pupil; None takes 128, or a
            Mask's own pixels if they are square.
        options: tolerance [waves], method, step, max_steps, backend, device, precision: see `trace`; and
            allow_truncation, whether more than a thousandth of the pupil may look through disturbed air that was cut
            off, and more than half of it past the field's box, as in `estimate_strehl`.

    Returns:
        A Wavefront; pixels whose ray did not arrive have weight 0, and `blocked` is their share of the pupil. In a gas
        that absorbs, weights and intensities contain the transmission.

    Raises:
        TypeError: `field` or `pupil` is of the wrong type.
        ValueError: A name is unknown or a number out of range; the wavelength is not the field's; no ray meets the
            field or arrives; or the view is truncated and `allow_truncation` is not set.
    """
    if not isinstance(field, IndexField):
        raise wrong_kind(field, "field", "an IndexField")
    if not isinstance(pupil, Pupil):
        raise wrong_kind(pupil, "pupil", "a Disc, Annulus, Rectangle, Polygon or Mask")
    wavelength = field.wavelength_for(wavelength)
    look = pupil.normal if direction is None else as_unit_vector(direction, "direction")
    whole: dict[str, Any] = dict(complete(options))
    air = pupil_air(field, pupil, look, whole["tolerance"] * wavelength)
    air.check(whole.pop("allow_truncation"))
    air.warn()
    aperture = seen_along(pupil, look)
    coordinate, pixel, weight, intensity = pupil_grid(aperture, pixel_count)
    lit = weight > 0.0
    rows, columns = np.nonzero(lit)
    first, second = aperture.axes
    start = pupil.center + coordinate[columns, None] * first + coordinate[rows, None] * second
    traced = trace(
        field,
        RayBundle(start, np.broadcast_to(look, start.shape), weight[lit]),
        until=plane_beyond(field, pupil, look),
        wavelength=wavelength,
        outputs=("opd", "step_error"),
        **whole,
    )
    assert traced.opd is not None  # requested above
    if not traced.ok.any():
        raise ValueError(
            f"no ray of the pupil arrived beyond the field ({traced.status_summary()}): move the pupil, or turn "
            "its normal toward the flow"
        )
    opd, arrived = np.full(weight.shape, np.nan), np.zeros(weight.shape)
    opd[lit] = traced.opd
    arrived[lit] = np.where(traced.ok, weight[lit], 0.0)
    passed = np.zeros(weight.shape)
    passed[lit] = np.where(traced.ok, traced.transmission, 0.0)
    return Wavefront(
        opd,
        arrived * np.sqrt(passed),
        pixel,
        wavelength,
        intensity=np.where(arrived > 0.0, intensity * passed, 0.0),
        radius=pupil.reach,
        pupil=pupil,
        direction=look,
        blocked=float(1.0 - arrived.sum() / weight.sum()),
        plan=replace(traced.plan, reasons=(*traced.plan.reasons, *air.misses)),
        seconds=dict(traced.seconds),
        varied=partial(getattr, traced, "variants"),
    )


@checked
def compare_wavefronts(
    first: Any, second: Any, pupil: Pupil | None = None, **options: Any
) -> WavefrontComparison[Wavefront]:
    """Compare two wavefronts, the wavefronts of two runs, or those of two flows over a pupil, in any combination.

    The result holds both wavefronts and their difference; its `quantities` are Strehl ratios, rms and correlation, with
    errors. An example:

        ak.compare_wavefronts(flow.shipped("mach2"), flow.shipped("mach3"), ak.Disc(0.004, center=(0, 0, -0.008)))

    Args:
        first: A Wavefront, a run (RunResult), a density field or an index field. The index of a density field is that
            of `index_field` at the wavelength, 905 nm if none is given.
        second: What is compared with it.
        pupil: The pupil of fields; wavefronts and runs have their own.
        options: Those of `wavefront` for fields, such as wavelength, direction and pixel_count.

    Raises:
        TypeError: An argument of another kind, or a field without a pupil.
        ValueError: The pixels, pupils, directions or wavelengths differ; a run has no wavefront; or what `wavefront`
            refuses.
    """
    one, other = (_wavefront_of(thing, pupil, options) for thing in (first, second))
    return one.compare(other)


def _wavefront_of(thing: Any, pupil: Pupil | None, options: dict[str, Any]) -> Wavefront:
    if not isinstance(thing, (IndexField, DensityField)):
        found = getattr(thing, "wavefront", thing)
        if found is None:
            raise ValueError(f"the run has no wavefront: {thing.failures.get('wavefront', 'it was left out')}")
        if not isinstance(found, Wavefront):
            raise TypeError(f"compare Wavefronts, runs or fields, got {type(thing).__name__}")
        return found
    if pupil is None:
        raise TypeError("a field has no wavefront without a pupil: give one, such as Disc(radius=0.004)")
    if isinstance(thing, DensityField):
        wavelength = options.get("wavelength")
        thing = thing.index_field() if wavelength is None else thing.index_field(wavelength)
    return wavefront(thing, pupil, **options)
