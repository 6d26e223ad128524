"""The same field with every second and every fourth node only, from which its interpolation error is estimated.

With f_h the optical path through all nodes, and f_2h, f_4h through every second and fourth, the order seen is
p = log2 |f_4h - f_2h| / |f_2h - f_h| and what is left in f_h about |f_2h - f_h| / (2^p - 1) (L. F. Richardson, Phil.
Trans. A 210 (1911) 307). A shock inside a cell shows order 1, noise of the samples order 1/2; an order above the
interpolant's own is not believed.

Cells that were cut in four to keep averages are compared with those that they were cut from, under the values that
these have by the same averages. For a mesh of which no vertices can be left out, the error is estimated on four times
the cells: see refined.py.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .kept_averages import conserving_values
from .mesh import QuadMesh
from .refined import refined
from .vertex_values import of_parents

ORDER = {"cubic": 4.0, "linear": 2.0, "monotone": 2.0, "bilinear": 2.0, "bilinear-barron": 2.0, "idw": 1.0}
# Values that change most have an order of their own: a feature about one cell wide shows none where all else is smooth.
SHARP_SHARE, LEAST_SHARP = 1.0 / 8.0, 4
# Of noise: the error of a sum over the nodes of a line goes with the square root of their spacing.
LOWEST_ORDER = 0.5
# The greatest order believed where the two changes of the sharpest values have opposite signs.
LEAST_ALIKE = 1.0
# Another interpolant of the same kind, for fields of too few nodes to leave any out.
OTHER = {"cubic": "linear", "linear": "cubic", "monotone": "cubic"}
# The error of a field over its change on four times the cells: slopes, whose error is halved, decide.
REFINED_SHARE = 2.0


@dataclass(frozen=True, eq=False)
class RefinementLevels:
    """A field and its coarser versions, all in one box.

    Attributes:
        fine: The field, cut by up to three rows of nodes where the coarser ones end earlier.
        coarse: With every second node, or under another interpolant where there are too few nodes, or on finer cells.
        coarser: With every fourth node, or None.
        share: Without a coarser field, the error of `fine` over its change against `coarse`.
    """

    fine: Any
    coarse: Any
    coarser: Any
    share: float = 1.0

    def richardson_error(self, fine: np.ndarray, coarse: np.ndarray, coarser: np.ndarray | None) -> np.ndarray:
        """Estimated error of the values `fine` of some quantity, from its values through the three fields."""
        if coarser is None:
            return self.share * (fine - coarse)
        return richardson_error(fine, coarse, coarser, ORDER[self.fine.interpolation])


def richardson_error(fine: np.ndarray, coarse: np.ndarray, coarser: np.ndarray, order: float) -> np.ndarray:
    """Estimated error of values through all nodes, from those through every second and fourth; `order` at most."""
    change, before = fine - coarse, coarse - coarser
    factor = np.full(np.shape(change), _left(before, change, order))
    size = np.abs(change)
    if len(size) >= LEAST_SHARP / SHARP_SHARE:
        sharp = size >= np.quantile(size, 1.0 - SHARP_SHARE)
        # Errors of one order have one sign at all spacings: where they have not, none of a high order is seen yet.
        alike = float(np.mean(before[sharp] * change[sharp])) > 0.0
        highest = order if alike else LEAST_ALIKE
        factor[sharp] = max(factor[0], _left(before[sharp], change[sharp], highest))
    return np.asarray(change * factor)


def _left(before: np.ndarray, after: np.ndarray, highest: float) -> float:
    """What is left over the change `after`, by the order, at most `highest`, seen in the rms of two changes."""
    first, second = (float(np.sqrt(np.mean(values**2))) for values in (before, after))
    order = highest if second == 0.0 else float(np.clip(np.log2(max(first / second, 1.0)), LOWEST_ORDER, highest))
    return 1.0 / (2.0**order - 1.0)


def refinement(field) -> RefinementLevels | None:
    """The field and its coarser versions, or a finer one; None on a mesh that can be neither thinned nor refined."""
    if field.interpolation == "cells":  # what an interpolant makes of them
        return RefinementLevels(field, field.with_interpolation("bilinear"), None)
    levels = _of_grid(field) if field.is_uniform else _of_mesh(field)
    if levels is not None:
        return RefinementLevels(*levels)
    if field.is_uniform:
        return RefinementLevels(field, field.with_interpolation(OTHER[field.interpolation]), None)
    finer = refined(field)
    return None if finer is None else RefinementLevels(field, finer, None, REFINED_SHARE)


def _of_grid(field):
    grid = field.samples
    if max(grid.shape) < 5:
        return None
    cut, strides = [], []
    for axis, count in enumerate(grid.shape):
        coarsest = 4 if count >= 9 else 2 if count >= 5 else 1
        surplus = (count - 1) % coarsest
        low = 0
        if surplus and not (axis == 0 and grid.even_first_axis):
            # Leave out the rows that vary less.
            moved = np.moveaxis(grid.samples, axis, 0)
            low_side = np.abs(np.diff(moved[: surplus + 1], axis=0)).max()
            low = surplus if low_side < np.abs(np.diff(moved[-surplus - 1 :], axis=0)).max() else 0
        cut.append(slice(low, count - surplus + low))
        strides.append(coarsest)

    def level(greatest: int):
        every = [min(s, greatest) for s in strides]
        samples = grid.samples[tuple(cut)][tuple(slice(None, None, s) for s in every)]
        low = np.array([c.start for c in cut])
        origin, spacing = grid.origin + low * grid.spacing, grid.spacing * np.array(every)
        return replace(field, samples=replace(grid, samples=samples, origin=origin, spacing=spacing))

    return level(1), level(2), level(4) if max(strides) == 4 else None


def _of_mesh(field):
    mesh = field.mesh
    if mesh.whole is not None and field.samples.averages is not None:
        values = conserving_values(mesh.whole, of_parents(mesh, field.samples.averages), 1.0 - field.ambient_index)
        before = replace(field.samples, mesh=mesh.whole, values=values, averages=None)
        return field, replace(field, samples=before), None
    if mesh.shape is None or max(mesh.shape) < 5:
        return None
    vertices = mesh.vertices.reshape(*mesh.shape, 2)
    values = field.samples.values.reshape(mesh.shape)

    def level(stride: int):
        rows, columns = (
            np.unique(np.append(np.arange(0, n, stride if n > 2 * stride else 1), n - 1)) for n in mesh.shape
        )
        kept = np.ix_(rows, columns)
        thinned = QuadMesh.structured(vertices[kept][..., 0], vertices[kept][..., 1], mesh.geometry)
        thin = replace(field.samples, mesh=thinned, values=values[kept].ravel(), averages=None)
        return replace(field, samples=thin)

    try:
        return field, level(2), level(4) if max(mesh.shape) > 8 else None
    except ValueError:  # thinning a strongly curved mesh can leave cells that are not convex
        return None
