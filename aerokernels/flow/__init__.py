"""Density fields of flows: gas relations, exact flows, flow files, and the flow fields shipped with the package.

Relations: `isentropic`, `tunnel_conditions`, `free_stream`, `normal_shock`, `oblique_shock`, `cone_shock`,
`prandtl_meyer`, `expansion_fan`, `Vortex`, `riemann`, `bow_shock`. Density fields of exact flows: `wedge`,
`plane_shock`, `cone`, `expansion`, `vortex`, `shock_tube`; from an approximate correlation: `blunt_body`; shipped:
`shipped`. Density to index: `refractivity_model`.
"""

from aerokernels.flow.reading import Contents, Frame, Reader, ReadError, Resampling, VolumeResampling, contents, read

from .billig import BowShock, bow_shock
from .blunt_body import BluntBodyFlow, blunt_body
from .ciddor import ciddor_constant, ciddor_refractivity, moist_air_density, water_fraction
from .conical_field import ConicalFlow, cone
from .conical_profile import ConeShock
from .density_field import CellDensity, DensityField
from .exact_field import ExactField
from .fan_field import ExpansionFan, expansion, expansion_fan, mach_after_turn, maximum_expansion
from .gas import (
    GAMMA_AIR,
    GAS_CONSTANT_AIR,
    SEA_LEVEL_DENSITY,
    FreeStream,
    Isentropic,
    OutsideTunnelWarning,
    free_stream,
    isentropic,
    tunnel_conditions,
)
from .models import MODELS, RefractivityModel, refractivity_model
from .refractivity import RELATIONS, gladstone_dale_constant, index_contrast, refractivity
from .riemann import GasState, Riemann, riemann
from .sampled_density import GridDensity, VertexDensity
from .series import GridMesh, Series
from .series_sources import open_series
from .shipped import shipped, shipped_names
from .shock_tube import TubeAtTime, shock_tube
from .shocks import PrandtlMeyer, Shock, maximum_deflection, normal_shock, oblique_shock, prandtl_meyer
from .species import SPECIES, SPECIES_NAMES, Composition, Species, species_constant
from .still_air import uniform_air
from .taylor_maccoll import cone_shock, maximum_cone_angle
from .vortex import Vortex, vortex
from .wedge_field import PlaneShock, plane_shock, wedge

__all__ = [
    "GAMMA_AIR",
    "GAS_CONSTANT_AIR",
    "MODELS",
    "RELATIONS",
    "SEA_LEVEL_DENSITY",
    "SPECIES",
    "SPECIES_NAMES",
    "BluntBodyFlow",
    "BowShock",
    "CellDensity",
    "Composition",
    "ConeShock",
    "ConicalFlow",
    "Contents",
    "DensityField",
    "ExactField",
    "ExpansionFan",
    "Frame",
    "FreeStream",
    "GasState",
    "GridDensity",
    "GridMesh",
    "Isentropic",
    "OutsideTunnelWarning",
    "PlaneShock",
    "PrandtlMeyer",
    "ReadError",
    "Reader",
    "RefractivityModel",
    "Resampling",
    "Riemann",
    "Series",
    "Shock",
    "Species",
    "TubeAtTime",
    "VertexDensity",
    "VolumeResampling",
    "Vortex",
    "blunt_body",
    "bow_shock",
    "ciddor_constant",
    "ciddor_refractivity",
    "cone",
    "cone_shock",
    "contents",
    "expansion",
    "expansion_fan",
    "free_stream",
    "gladstone_dale_constant",
    "index_contrast",
    "isentropic",
    "mach_after_turn",
    "maximum_cone_angle",
    "maximum_deflection",
    "maximum_expansion",
    "moist_air_density",
    "normal_shock",
    "oblique_shock",
    "open_series",
    "plane_shock",
    "prandtl_meyer",
    "read",
    "refractivity",
    "refractivity_model",
    "riemann",
    "shipped",
    "shipped_names",
    "shock_tube",
    "species_constant",
    "tunnel_conditions",
    "uniform_air",
    "vortex",
    "water_fraction",
    "wedge",
]
