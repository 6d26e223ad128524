"""Air at rest in a box."""

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_positive
from ..medium import Body, QuadMesh
from .density_field import CellDensity
from .gas import SEA_LEVEL_DENSITY


@checked
def uniform_air(
    density: float = SEA_LEVEL_DENSITY,
    *,
    body: Body | None = None,
    radius: float = 0.04,
    z_range: tuple[float, float] = (-0.04, 0.01),
) -> CellDensity:
    """Air at rest, the same everywhere: what a tunnel holds before it is started.

    Args:
        density: [kg/m3].
        body: A solid body standing in it.
        radius: Radius of the axisymmetric box the field is given on [m]; beyond it the air is the same.
        z_range: Lowest and highest z of the box [m].

    Raises:
        ValueError: A density or radius that is not positive and finite, or a range that does not increase.
    """
    check_positive(radius, "radius")
    low, high = z_range
    if not low < high:
        raise ValueError(f"z_range must increase, got {z_range!r}")
    # Eight cells are more than a constant needs; five-point gradients need four.
    nodes = np.meshgrid(np.linspace(0.0, radius, 9), np.linspace(low, high, 9), indexing="ij")
    mesh, ambient = QuadMesh.structured(*nodes, "axisymmetric"), check_positive(density, "density")
    return CellDensity(mesh, np.full(len(mesh.cells), ambient), ambient, body, None, f"air at rest, {ambient:g} kg/m3")
