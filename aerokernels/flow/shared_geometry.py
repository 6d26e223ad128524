"""Let flows with equal meshes and bodies share the objects, and with them the geometry computed from these."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from .density_field import DensityField, SampledDensity


def on_known_geometry(flow: DensityField, known: Sequence[DensityField]) -> DensityField:
    """Return a flow with its mesh and body replaced by the equal mesh and body of a known flow, where there are such.

    Geometry computed from a mesh or a body is cached on that object: with the same object, another snapshot or another
    density field does not compute it again.
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
