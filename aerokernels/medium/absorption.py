"""The absorption coefficient of a gas, in the box of an index field and around it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aerokernels.inputs.checks import check_at_least
from aerokernels.medium.averages.kept_averages import conserving_values
from aerokernels.medium.grid import UniformGrid, contrast_without_gradient
from aerokernels.medium.mesh_samples import MeshSamples

# A coefficient is interpolated as a contrast as small as this, of which the optical potential is a multiple.
SMALL = 1e-9


@dataclass(frozen=True, eq=False)
class Absorption:
    """An absorption coefficient kappa [1/m]: light of a path s is weakened by exp(-integral of kappa ds).

    Attributes:
        inside: Coefficient at points (n, 3) [m] in the field's box, shape (n,).
        ambient: Coefficient outside the box.
        spacing: Length over which it is taken to be a smooth function [m]: a cell.
        symmetric: Whether it has the symmetry of the field's geometry.
    """

    inside: Callable[[np.ndarray], np.ndarray]
    ambient: float
    spacing: float
    symmetric: bool = True


def absorption_of(field: Any, coefficient: Any, ambient: float) -> Absorption:
    """Return the absorption of `IndexField.with_absorption`."""
    check_at_least(ambient, "ambient", 0.0)
    spacing = float(np.min(field.spacing))
    if callable(coefficient):
        return Absorption(coefficient, float(ambient), spacing, False)
    values = np.asarray(coefficient, dtype=np.float64)
    if not (np.isfinite(values).all() and (values >= 0.0).all()):
        raise ValueError("the absorption coefficient must be finite and not negative everywhere [1/m]")
    if values.ndim == 0:
        return Absorption(_Uniform(float(values)), float(ambient), spacing)
    return Absorption(_Sampled.of(field, values), float(ambient), spacing)


@dataclass(frozen=True)
class _Uniform:
    value: float

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return np.full(len(points), self.value)


@dataclass(frozen=True, eq=False)
class _Sampled:
    """A coefficient where the samples of an IndexField are, by the field's interpolant, at least 0."""

    field: Any
    scale: float

    @classmethod
    def of(cls, field: Any, values: np.ndarray) -> "_Sampled":
        scale = max(float(values.max()), 1e-300) / SMALL
        samples = field.samples
        if isinstance(samples, UniformGrid):
            if values.shape != samples.shape:
                raise ValueError(f"the absorption has shape {values.shape}, the samples of the field {samples.shape}")
            own: Any = replace(samples, samples=values / scale, ambient_index=1.0, keeps_averages=False)
        else:
            at_vertices, in_cells = samples.mesh.array_shapes
            if values.shape not in (*at_vertices, *in_cells):
                raise ValueError(
                    f"the absorption has shape {values.shape}: give one entry for each vertex, shape "
                    f"{' or '.join(map(str, at_vertices))}, or cell, shape {' or '.join(map(str, in_cells))}"
                )
            flat = values.ravel() / scale
            if values.shape in in_cells:
                flat = conserving_values(samples.mesh, flat, -np.inf)
            own = MeshSamples(samples.mesh, flat, samples.interpolation)
        return cls(replace(field, samples=own, ambient_index=1.0, resampling=None, upstream=None), scale)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return np.maximum(contrast_without_gradient(self.field, points), 0.0) * self.scale
