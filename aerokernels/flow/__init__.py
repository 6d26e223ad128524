"""Density fields of flows: gas relations, exact flows, flow files, and the flow fields shipped with the package."""

from typing import TYPE_CHECKING

from aerokernels import attributes_of
from aerokernels.flow.air import gladstone_dale_constant
from aerokernels.flow.blunt_body import BluntBodyFlow, BowShock, blunt_body, bow_shock
from aerokernels.flow.ciddor import ciddor_constant, ciddor_refractivity, moist_air_density, water_fraction
from aerokernels.flow.composition import Composition
from aerokernels.flow.conical_field import ConicalFlow, cone
from aerokernels.flow.density_field import DensityField
from aerokernels.flow.exact_field import ExactField, Vortex, uniform_air, vortex
from aerokernels.flow.gas import (
    GAMMA_AIR,
    GAS_CONSTANT_AIR,
    SEA_LEVEL_DENSITY,
    Atmosphere,
    FreeStream,
    Isentropic,
    free_stream,
    isentropic,
    standard_atmosphere,
    tunnel_conditions,
)
from aerokernels.flow.mathar import mathar_constant, mathar_refractivity
from aerokernels.flow.plane_flows import (
    ExpansionFan,
    PlaneShock,
    expansion,
    expansion_fan,
    mach_after_turn,
    maximum_expansion,
    wedge,
)
from aerokernels.flow.refractivity import (
    MODELS,
    RELATIONS,
    RefractivityModel,
    index_contrast,
    refractivity_model,
)
from aerokernels.flow.sampled_density import CellDensity, GridDensity, VertexDensity
from aerokernels.flow.shipped import shipped, shipped_names
from aerokernels.flow.shocks import PrandtlMeyer, Shock, maximum_deflection, normal_shock, oblique_shock, prandtl_meyer
from aerokernels.flow.species import SPECIES, SPECIES_NAMES, Species, species_constant
from aerokernels.flow.taylor_maccoll import ConeShock, cone_shock, maximum_cone_angle

if TYPE_CHECKING:
    from aerokernels.flow.absorbers import absorption_coefficient, cross_section
    from aerokernels.flow.hot_air import equilibrium_air
    from aerokernels.flow.reading import Contents, Frame, ReadError, Resampling, VolumeResampling, contents
    from aerokernels.flow.reading.read import Reader, read
    from aerokernels.flow.series import GridMesh, Series
    from aerokernels.flow.series_sources import open_series

__all__ = [
    "GAMMA_AIR",
    "GAS_CONSTANT_AIR",
    "MODELS",
    "RELATIONS",
    "SEA_LEVEL_DENSITY",
    "SPECIES",
    "SPECIES_NAMES",
    "Atmosphere",
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
    "GridDensity",
    "GridMesh",
    "Isentropic",
    "PlaneShock",
    "PrandtlMeyer",
    "ReadError",
    "Reader",
    "RefractivityModel",
    "Resampling",
    "Series",
    "Shock",
    "Species",
    "VertexDensity",
    "VolumeResampling",
    "Vortex",
    "absorption_coefficient",
    "blunt_body",
    "bow_shock",
    "ciddor_constant",
    "ciddor_refractivity",
    "cone",
    "cone_shock",
    "contents",
    "cross_section",
    "equilibrium_air",
    "expansion",
    "expansion_fan",
    "free_stream",
    "gladstone_dale_constant",
    "index_contrast",
    "isentropic",
    "mach_after_turn",
    "mathar_constant",
    "mathar_refractivity",
    "maximum_cone_angle",
    "maximum_deflection",
    "maximum_expansion",
    "moist_air_density",
    "normal_shock",
    "oblique_shock",
    "open_series",
    "prandtl_meyer",
    "read",
    "refractivity_model",
    "shipped",
    "shipped_names",
    "species_constant",
    "standard_atmosphere",
    "tunnel_conditions",
    "uniform_air",
    "vortex",
    "water_fraction",
    "wedge",
]

# Modules that read files, or that few flows need, which are imported when one of their names is first used.
_FILES = ("Contents", "Frame", "ReadError", "Reader", "Resampling", "VolumeResampling", "contents", "read")
_MODULE_OF = {
    "GridMesh": "series",
    "Series": "series",
    "absorption_coefficient": "absorbers",
    "cross_section": "absorbers",
    "equilibrium_air": "hot_air",
    "open_series": "series_sources",
}
__getattr__ = attributes_of(__name__, dict.fromkeys(_FILES, "reading") | _MODULE_OF)
