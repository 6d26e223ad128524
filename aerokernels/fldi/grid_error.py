"""What the field itself makes a phase off by: its grid, a resampling, how it was made from a flow.

The rays of both beams gather their phases along the same lines through the field with every second and every fourth
node (medium/levels.py), through the field that it was resampled from, and of what the interpolant of cells lacks of
their averages. What is left of each ray's difference of phases is summed by light, without sign: errors of neighbouring
cells have any, and would cancel by chance.

Beams are often narrower than a cell, so that all rays see one place of the grid, where a change may vanish by chance:
what the change between the two coarser grids foretells at the greatest order is added to what is left of the finer one.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from ..medium import IndexField
from ..medium.levels import ORDER, richardson_error
from ..medium.mesh_samples import MeshSamples
from ..rays import RayBundle
from ..tracing.average_deficit import deficit_integrals
from ..tracing.lines import cell_along
from ..tracing.stop import Plane
from .instrument import FLDI
from .rays import gathered, layer_count, ray_points

# Kinks at the faces of cells, which make slopes of the first order, average out along a beam.
LEAST_FORETOLD = 2.0
# Of what is left by orders that are seen at few nodes, where none has settled.
SAFETY = 1.5
Gather = Callable[[IndexField], np.ndarray]


def grid_error(
    field: IndexField,
    instrument: FLDI,
    places: np.ndarray,
    share: np.ndarray,
    focus: np.ndarray,
    ends: tuple[float, float],
) -> float:
    """What the phase may be off by through the field's samples [rad]; NaN where that is not known.

    Args:
        field: The refractive index.
        instrument: The instrument.
        places: Places of the rays that judge it in units of a beam's radius, shape (n, 2).
        share: Their shares of the light, shape (n,).
        focus: The instrument's focus [m], shape (3,).
        ends: Distances from the focus between which light is in the field's box [m].
    """
    per_metre = 2.0 * np.pi / instrument.wavelength
    layers = layer_count(field, instrument, ends)

    def difference(one: IndexField) -> np.ndarray:
        many = max(layers, layer_count(one, instrument, ends))
        (first, second), _ = gathered(one, instrument, places, focus, ends, layers=many)
        return per_metre * (first - second)

    source = field.source
    if source is None:
        return float("nan")
    here = difference(field)
    left, there = _interpolation(source, difference, here if source is field else None)
    if left is None:
        return float("nan")
    total = SAFETY * float(share @ left)
    if source is not field:
        total += float(share @ np.abs(here - there))
    total += per_metre * float(share @ np.abs(_lacking(source, instrument, places, focus, ends)))
    if field.upstream is not None:
        cell = float(cell_along(source, np.asarray(instrument.direction)[None])[0])
        apart = np.sqrt(2.0) * min(1.0, instrument.separation / cell)
        total += per_metre * field.upstream.columns * apart
        total += field.upstream.refractivity * abs(float(share @ here))
    return total


def _interpolation(field: IndexField, difference: Gather, known: np.ndarray | None):
    """Size of the interpolation error of each ray's difference of phases [rad], None if not known; the difference.

    `known` is that difference where it was gathered already.
    """
    levels = field.refinement
    if levels is None:
        return None, known
    whole = difference(field) if known is None else known
    fine = whole if levels.fine is field else difference(levels.fine)
    coarse = difference(levels.coarse)
    if levels.coarser is None:
        return np.abs(levels.richardson_error(fine, coarse, None)), whole
    before = difference(levels.coarser)
    order = ORDER[levels.fine.interpolation] - 1.0  # of slopes, which are what close beams see
    factor = 2.0 ** max(order, LEAST_FORETOLD)
    foretold = np.abs(coarse - before) / (factor * (factor - 1.0))
    return np.abs(richardson_error(fine, coarse, before, order)) + foretold, whole


def _lacking(
    field: IndexField, instrument: FLDI, places: np.ndarray, focus: np.ndarray, ends: tuple[float, float]
) -> np.ndarray:
    """What cells lack of their averages, of the first beam's rays less the second's [m], shape (n,).

    Along straight lines to the focus and from there.
    """
    found = np.zeros(len(places))
    if not isinstance(field.samples, MeshSamples) or field.samples.lacking is None:
        return found
    stops = [ends[0], *([0.0] if ends[0] < 0.0 < ends[1] else []), ends[1]]
    for side in (0.5, -0.5):
        at = [ray_points(instrument, places, focus, side, np.full((1, len(places)), place))[0] for place in stops]
        for begin, end in pairwise(at):
            found += (
                2.0 * side * deficit_integrals(field, RayBundle(begin, end - begin), Plane(end[0], instrument.axis))
            )
    return found
