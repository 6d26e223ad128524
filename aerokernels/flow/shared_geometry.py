"""Flows on one mesh, about one body: what was worked out of the geometry for one of them serves the others."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from .density_field import DensityField, SampledDensity


def on_known_geometry(flow: DensityField, known: Sequence[DensityField]) -> DensityField:
    """A flow on the very mesh, and about the very body, of a known one where those are equal, or as it is.

    A mesh and a body keep what was worked out of them: another snapshot, or another density, need not do it again.
    """
    if not isinstance(flow, SampledDensity):
        return flow
    shared: dict[str, Any] = {}
    for name in ("mesh", "body"):
        own = getattr(flow, name, None)
        for other in (getattr(each, name, None) for each in known):
            if own is not None and other is not own and own.equals(other):
                shared[name] = other
    return replace(flow, **shared) if shared else flow  # type: ignore[type-var]
