"""Error of a phase due to the field: its grid, a resampling, and its origin from a flow.

The phases of both beams' rays are integrated along the same lines through the field with every second and every fourth
node (medium/levels.py), through the field that it was resampled from, and over the deficit of the interpolant against
cell averages. The errors of each ray's phase difference are summed by light as absolute values: the signs of errors in
neighbouring cells are random, and they would cancel by chance.

Beams are often narrower than a cell, so that all rays are in one cell of the grid, where a change may vanish by chance.
So the error predicted at the greatest order from the change between the two coarser grids is added to the error of the
finer one.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from ..medium import IndexField
from ..medium.levels import ORDER, richardson_error
from ..medium.mesh_samples import MeshSamples
from ..rays import RayBundle
from ..tracing.error_budget.average_deficit import deficit_integrals
from ..tracing.lines import cell_along
from ..tracing.stop import Plane
from .instrument import FLDI
from .rays import gathered, layer_count, ray_points

# Least order of the prediction: kinks at cell faces, which make slopes first order, average out along a beam.
LEAST_FORETOLD = 2.0
# Factor on the extrapolated error: orders observed at few nodes have not settled.
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
    """Return the error of the phase due to the field's samples [rad]; NaN if it is not known.

    Args:
        field: The refractive index.
        instrument: The instrument.
        places: Positions of the test rays in units of a beam's radius, shape (n, 2).
        share: Shares of the light of these rays, shape (n,).
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
    """Return the absolute interpolation error of each ray's phase difference [rad], None if not known; the difference.

    `known` is that difference if it was computed already.
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
    order = ORDER[levels.fine.interpolation] - 1.0  # the order of slopes, which close beams measure
    factor = 2.0 ** max(order, LEAST_FORETOLD)
    foretold = np.abs(coarse - before) / (factor * (factor - 1.0))
    return np.abs(richardson_error(fine, coarse, before, order)) + foretold, whole


def _lacking(
    field: IndexField, instrument: FLDI, places: np.ndarray, focus: np.ndarray, ends: tuple[float, float]
) -> np.ndarray:
    """Return the deficit against cell averages of the first beam's rays minus the second's [m], shape (n,).

    It is summed along straight lines to the focus and from there.
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
