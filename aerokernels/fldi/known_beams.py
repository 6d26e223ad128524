"""Share of an interferometer's light that goes through disturbed air that was cut off the field.

Straight lines from the focus to both ends of the beams are tested, as for a pupil (tracing/pupil/air.py): a line counts
if it loses more of its optical path than the tolerance. A field whose box is its whole flow costs nothing.
"""

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing.cuts import lost, may_lose
from ..tracing.lines import box_size
from ..tracing.pupil.air import GREATEST_SHARE, TruncationWarning
from ..tracing.stop import ways_through
from .instrument import FLDI

# Lines across a beam, and path that a line may lose [waves].
LINES, TOLERANCE = 33, 1e-3


def truncated_share(
    field: IndexField, instrument: FLDI, focus: np.ndarray, ends: tuple[float, float] | None, reach: float
) -> float:
    """Return the share of the light of both beams that loses more than the tolerance by cuts.

    Args:
        field: The refractive index.
        instrument: The instrument.
        focus: Focus of the instrument [m], shape (3,).
        ends: Distances from the focus along the axis between which light is in the field's box [m]; None if it misses
            the box.
        reach: Radii up to which a beam is traced.
    """
    tolerance = TOLERANCE * instrument.wavelength
    if not may_lose(field, tolerance):
        return 0.0
    if ends is None:
        along, size = float(ways_through(field.box, focus, instrument.axis)[0]), box_size(field)
        ends = along - size, along + size
    first, second = instrument.direction, instrument.normal
    assert first is not None
    u, v = (axis.ravel() for axis in np.meshgrid(*(2 * [np.linspace(-reach, reach, LINES)])))
    light = np.exp(-2.0 * (u**2 + v**2)) * (u**2 + v**2 <= reach**2)
    across = u[:, None] * first + v[:, None] * second
    over = np.zeros((2, len(light)), dtype=bool)
    for beam, side in enumerate((0.5, -0.5)):
        middle = focus + side * instrument.separation * first
        for end in ends:
            # From the focus; from the middle of the range if the focus is this end.
            begin = 0.0 if abs(end) > 1e-6 * (ends[1] - ends[0]) else 0.5 * (ends[0] + ends[1])
            start = middle + begin * instrument.axis + float(instrument.radius(begin)) * across
            if end * (ends[0] + ends[1]) < 0.0 and ends[0] * ends[1] > 0.0:
                continue  # the whole box is on the other side of the focus
            way = middle + end * instrument.axis + float(instrument.radius(end)) * across - start
            rays = RayBundle(start, way / np.linalg.norm(way, axis=1)[:, None])
            over[beam] |= np.abs(lost(field, rays, None, tolerance=tolerance)) > tolerance
    return float(light @ over.mean(axis=0) / light.sum())


def warn_of_truncation(share: float) -> None:
    """Warn the caller of `fldi_response` if more than a thousandth of the light is truncated."""
    if share > GREATEST_SHARE:
        text = (
            f"{100.0 * share:.3g} % of the light goes through disturbed air that was cut off the field, and is in no "
            "error; give the field a larger region there, move the focus or turn the axis"
        )
        warn_caller(text, TruncationWarning)
