"""Where density comes from: gas relations, exact flows, and the flow fields that come with the package."""

from .conical_field import ConicalFlow, cone
from .conical_profile import ConeShock
from .density_field import DensityField, uniform_air
from .gas import (
    GAMMA_AIR,
    GAS_CONSTANT_AIR,
    SEA_LEVEL_DENSITY,
    FreeStream,
    Isentropic,
    isentropic,
    tunnel_conditions,
)
from .refractivity import RELATIONS, gladstone_dale_constant, index_contrast, refractivity
from .shipped import shipped, shipped_names
from .shocks import PrandtlMeyer, Shock, maximum_deflection, normal_shock, oblique_shock, prandtl_meyer
from .taylor_maccoll import cone_shock, maximum_cone_angle

__all__ = [
    "GAMMA_AIR",
    "GAS_CONSTANT_AIR",
    "RELATIONS",
    "SEA_LEVEL_DENSITY",
    "ConeShock",
    "ConicalFlow",
    "DensityField",
    "FreeStream",
    "Isentropic",
    "PrandtlMeyer",
    "Shock",
    "cone",
    "cone_shock",
    "gladstone_dale_constant",
    "index_contrast",
    "isentropic",
    "maximum_cone_angle",
    "maximum_deflection",
    "normal_shock",
    "oblique_shock",
    "prandtl_meyer",
    "refractivity",
    "shipped",
    "shipped_names",
    "tunnel_conditions",
    "uniform_air",
]
