"""Coarser versions of a field, with every second and every fourth node, for estimating its interpolation error.

If f_h is the optical path through the field with all nodes, and f_2h, f_4h with every second and fourth, the observed
order is p = log2 |f_4h - f_2h| / |f_2h - f_h|, and the error of f_h is about |f_2h - f_h| / (2^p - 1) (L. F.
Richardson, Phil. Trans. A 210 (1911) 307). A shock inside a cell gives order 1, noise of the samples order 1/2. The
order is limited to that of the interpolant.

A mesh whose cells were cut in four to keep averages is compared with the mesh before the cut, with the values that it
has for the same averages. For a mesh whose vertices cannot be thinned out, the error is estimated from a mesh of four
times the cells: see refined.py.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .averages.kept_averages import conserving_values
from .averages.vertex_values import of_parents
from .mesh import QuadMesh
from .refined import refined

ORDER = {"cubic": 4.0, "linear": 2.0, "monotone": 2.0, "bilinear": 2.0, "bilinear-barron": 2.0, "idw": 1.0}
# The values that change most get an order of their own, because a feature about one cell wide converges slowly even if
# the rest of the field is smooth: the fraction of values, and their least number.
SHARP_SHARE, LEAST_SHARP = 1.0 / 8.0, 4
# Order for noise: the error of a sum over the nodes of a line is proportional to the square root of their spacing.
LOWEST_ORDER = 0.5
# Greatest order assumed where the two changes of the sharpest values have opposite signs.
HIGHEST_OF_TWO_SIGNS = 1.0
# Interpolant for comparison where a field has too few nodes to leave any out.
OTHER = {"cubic": "linear", "linear": "cubic", "monotone": "cubic"}
# Error of a field over its change on four times the cells: the error of slopes, which is only halved, decides.
REFINED_SHARE = 2.0


@dataclass(frozen=True, eq=False)
class RefinementLevels:
    """A field and its coarser versions, all in one box.

    Attributes:
        fine: The field, without up to three rows of nodes at an end that the coarser ones do not reach.
        coarse: The field with every second node, or with another interpolant if there are too few nodes, or on finer
            cells.
        coarser: The field with every fourth node, or None.
        share: Without `coarser`, the error of `fine` over its change against `coarse`.
    """

    fine: Any
    coarse: Any
    coarser: Any
    share: float = 1.0

    def richardson_error(self, fine: np.ndarray, coarse: np.ndarray, coarser: np.ndarray | None) -> np.ndarray:
        """Return the estimated error of a quantity's values `fine`, from its values in all three fields."""
        if coarser is None:
            return self.share * (fine - coarse)
        return richardson_error(fine, coarse, coarser, ORDER[self.fine.interpolation])


def richardson_error(fine: np.ndarray, coarse: np.ndarray, coarser: np.ndarray, order: float) -> np.ndarray:
    """Return the estimated error of values with all nodes, from those with every second and fourth node.

    Args:
        fine: Values with all nodes, shape (n,).
        coarse: Values with every second node.
        coarser: Values with every fourth node.
        order: Greatest order assumed.
    """
    change, before = fine - coarse, coarse - coarser
    factor = np.full(np.shape(change), _remaining_share(before, change, order))
    size = np.abs(change)
    if len(size) >= LEAST_SHARP / SHARP_SHARE:
        sharp = size >= np.quantile(size, 1.0 - SHARP_SHARE)
        # In the asymptotic range errors have one sign at all spacings. Where they do not, a high order is not assumed.
        one_sign = float(np.mean(before[sharp] * change[sharp])) > 0.0
        highest = order if one_sign else HIGHEST_OF_TWO_SIGNS
        factor[sharp] = max(factor[0], _remaining_share(before[sharp], change[sharp], highest))
    return np.asarray(change * factor)


def _remaining_share(before: np.ndarray, after: np.ndarray, highest: float) -> float:
    """Return the remaining error over the change `after`, by the order that the rms of both changes show."""
    first, second = (float(np.sqrt(np.mean(values**2))) for values in (before, after))
    order = highest if second == 0.0 else float(np.clip(np.log2(max(first / second, 1.0)), LOWEST_ORDER, highest))
    return 1.0 / (2.0**order - 1.0)


def cached_refinement(field) -> RefinementLevels | None:
    """Return `refinement` of the field, cached on it without a reference back: a cycle would keep its memory."""

    def make() -> RefinementLevels | None:
        levels = refinement(field)
        return replace(levels, fine=None) if levels is not None and levels.fine is field else levels

    kept: RefinementLevels | None = field.derive("refinement", make)
    return replace(kept, fine=field) if kept is not None and kept.fine is None else kept


def refinement(field) -> RefinementLevels | None:
    """Return the field with coarser versions, or a finer one; None if a mesh can be neither thinned nor refined."""
    if field.interpolation == "cells":  # compared with an interpolant of the same averages
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
            # Leave out the rows at the end where the samples vary less.
            moved = np.moveaxis(grid.samples, axis, 0)
            low_side = np.abs(np.diff(moved[: surplus + 1], axis=0)).max()
            low = surplus if low_side < np.abs(np.diff(moved[-surplus - 1 :], axis=0)).max() else 0
        cut.append(slice(low, count - surplus + low))
        strides.append(coarsest)

    def level(greatest: int):
        every = [min(s, greatest) for s in strides]
        if max(every) == 1 and all(c.stop - c.start == count for c, count in zip(cut, grid.shape, strict=True)):
            return field  # with its spline and tables
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
