"""The flow fields that come with the package: a wind-tunnel model at Mach 2, 3 and 4 (see data/PROVENANCE.txt)."""

from importlib.resources import files

import numpy as np

from ..arguments import checked
from ..medium import Body, QuadMesh
from .density_field import CellDensity
from .gas import FreeStream, tunnel_conditions

_DATA = files(__package__) / "data"
_NAMES = ("mach2", "mach3", "mach4")


def shipped_names() -> tuple[str, ...]:
    """Names that `shipped` knows.

    Examples:
        >>> shipped_names()
        ('mach2', 'mach3', 'mach4')
    """
    return _NAMES


@checked
def shipped(name: str) -> CellDensity:
    """A shipped CFD field of the wind-tunnel model.

    Steady axisymmetric inviscid air, 250 x 80 cells, with the model as its body. The files count x downstream from the
    nose tip; the field is in the optical frame, z = -x.

    Args:
        name: "mach2", "mach3" or "mach4".

    Raises:
        ValueError: An unknown name; the message lists the known ones.
    """
    if name not in _NAMES:
        raise ValueError(f"there is no shipped flow field {name!r}: choose one of {', '.join(_NAMES)}")
    with (_DATA / f"{name}.npz").open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        radius, z = data["r"], -data["x"]
        density, ambient_density, conditions = data["rho"], float(data["rho_inf"]), _free_stream(data)
    z[z == 0.0] = 0.0  # no negative zero at the nose tip
    mesh = QuadMesh.structured(radius, z, "axisymmetric")
    return CellDensity(
        mesh=mesh,
        density=density,
        ambient_density=ambient_density,
        body=Body(_wall(radius, z), "axisymmetric"),
        conditions=conditions,
        provenance=f"shipped field {name}: rhoCentralFoam (OpenFOAM 1912), inviscid, "
        f"{density.shape[0]} x {density.shape[1]} cells",
    )


def _free_stream(data) -> FreeStream:
    """The free stream from the stagnation state; the solver was started with the same relations."""
    return tunnel_conditions(
        float(data["mach"]),
        float(data["p0"]),
        float(data["T0"]),
        gamma=float(data["gamma"]),
        gas_constant=float(data["R"]),
    )


def _wall(radius: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The model's outline, shape (k, 2): the wall from the nose tip on, then the base back to the axis."""
    wall = np.stack([radius[:, 0], z[:, 0]], axis=1)
    return np.vstack([wall, [0.0, z[-1, 0]]])
