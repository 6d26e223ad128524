"""The scenes of the Strehl suites: shipped flows in front of a forward pupil. The cone is in cone.py."""

from dataclasses import dataclass

import numpy as np

from aerokernels.flow import shipped
from aerokernels.medium import IndexField
from aerokernels.rays import Disc

WAVELENGTH = 905e-9

STREHL_PUPIL = Disc(6e-3, np.array([0.0, 0.0, -8e-3]))
STREHL_SPACING = 5e-5  # [m]
STREHL_REGION = ((0.0, -9e-3), (7.5e-3, 4.4e-3))  # lowest and highest (r, z) [m]


@dataclass(frozen=True, eq=False)
class PupilScene:
    """A field that a pupil looks through."""

    field: IndexField
    pupil: Disc


def strehl_scene(flow: str = "mach3", ambient_density: float | None = None) -> PupilScene:
    """The part of a shipped flow seen by the forward pupil, resampled; a new field at every call.

    Args:
        flow: A shipped flow's name.
        ambient_density: Density of the free stream [kg/m3], None for the flow's own.
    """
    density = shipped(flow)
    if ambient_density is not None:
        density = density.scaled(ambient_density)
    field = density.index_field(WAVELENGTH, "paper").resample(STREHL_SPACING, region=STREHL_REGION)
    return PupilScene(field, STREHL_PUPIL)
