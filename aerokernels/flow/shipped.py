"""The flow fields shipped with the package: a wind-tunnel model at Mach 2, 3 and 4, and its dome at incidence.

See data/PROVENANCE.txt.
"""

from importlib.resources import files
from typing import Literal, overload

import numpy as np

from aerokernels.flow.gas import FreeStream, tunnel_conditions
from aerokernels.flow.sampled_density import CellDensity, GridDensity
from aerokernels.inputs.arguments import checked
from aerokernels.medium import Body, QuadMesh, SolidBody

_DATA = files(__package__) / "data"
VOLUME = "dome-alpha10"
_NAMES = ("mach2", "mach3", "mach4", VOLUME)


def shipped_names() -> tuple[str, ...]:
    """Return the names that `shipped` takes."""
    return _NAMES


@overload
def shipped(name: Literal["dome-alpha10"]) -> GridDensity: ...  # type: ignore[overload-overlap]


@overload
def shipped(name: str) -> CellDensity: ...


@checked
def shipped(name: str) -> CellDensity | GridDensity:
    """Return a shipped CFD field of the wind-tunnel model, in the optical frame: z points upstream, the nose is at 0.

    Each is a steady inviscid flow of air. "mach2", "mach3" and "mach4" are axisymmetric, with 250 x 80 cells and the
    model as body. "dome-alpha10" is the flow over the model's dome at Mach 3 and an angle of attack of 10 degrees (the
    wind comes from below and blows toward -z and +y), a volume on a uniform grid.

    Args:
        name: "mach2", "mach3", "mach4" or "dome-alpha10".

    Raises:
        ValueError: An unknown name; the message lists the known ones.
    """
    if name not in _NAMES:
        raise ValueError(f"there is no shipped flow field {name!r}: choose one of {', '.join(_NAMES)}")
    if name == VOLUME:
        return _volume(name)
    with (_DATA / f"{name}.npz").open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        radius, z = data["r"], -data["x"]
        density, ambient_density, conditions = data["rho"], float(data["rho_inf"]), _free_stream(data)
    z[z == 0.0] = 0.0  # no negative zero at the nose tip
    mesh = QuadMesh.structured(radius, z, "axisymmetric")
    wall = np.stack([radius[:, 0], z[:, 0]], axis=1)  # from the nose tip; the base goes back to the axis
    return CellDensity(
        mesh=mesh,
        density=density,
        ambient_density=ambient_density,
        body=Body(np.vstack([wall, [0.0, z[-1, 0]]]), "axisymmetric"),
        conditions=conditions,
        provenance=f"shipped field {name}: rhoCentralFoam (OpenFOAM 1912), inviscid, "
        f"{density.shape[0]} x {density.shape[1]} cells",
    )


def _volume(name: str) -> GridDensity:
    """Return a volume that is symmetric about x = 0, of which the file holds one half."""
    from aerokernels.flow.reading import VolumeResampling

    with (_DATA / f"{name}.npz").open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        half, origin, spacing = data["rho"].astype(np.float64), data["origin"].copy(), data["spacing"]
        ambient, conditions, profile = float(data["rho_inf"]), _free_stream(data), data["profile"]
        errors, alpha = data["resampling"].tolist(), float(data["alpha"])
    origin[0] -= spacing[0] * (len(half) - 1)
    return GridDensity(
        density=np.concatenate([half[:0:-1], half]),
        origin=origin,
        spacing=spacing,
        geometry="volume",
        ambient_density=ambient,
        body=SolidBody.of_revolution(Body(profile, "axisymmetric")),
        conditions=conditions,
        provenance=f"shipped field {name}: rhoCentralFoam (OpenFOAM 1912), inviscid, 31,680 cells in one half, "
        f"angle of attack {np.degrees(alpha):g} degrees",
        resampling=VolumeResampling(tuple(spacing.tolist()), *errors),
    )


def _free_stream(data) -> FreeStream:
    """Return the free stream, by the relations with which the solver was initialised."""
    mach, pressure, temperature, gamma, gas = (float(data[name]) for name in ("mach", "p0", "T0", "gamma", "R"))
    return tunnel_conditions(mach, pressure, temperature, gamma=gamma, gas_constant=gas)
