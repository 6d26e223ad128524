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
    """Return uniform air at rest, such as that in a tunnel before it is started.

    Args:
        density: [kg/m3].
        body: A solid body in the air.
        radius: Radius of the axisymmetric box of the field [m]; the air outside it is the same.
        z_range: Lowest and highest z of the box [m].

    Raises:
        ValueError: A density or radius that is not positive and finite, or a range that does not increase.
    """
    check_positive(radius, "radius")
    low, high = z_range
    if not low < high:
        raise ValueError(f"z_range must increase, got {z_range!r}")
    # Five-point gradients need four cells; eight leave some room.
    nodes = np.meshgrid(np.linspace(0.0, radius, 9), np.linspace(low, high, 9), indexing="ij")
    mesh, ambient = QuadMesh.structured(*nodes, "axisymmetric"), check_positive(density, "density")
    return CellDensity(mesh, np.full(len(mesh.cells), ambient), ambient, body, None, f"air at rest, {ambient:g} kg/m3")
