"""Refractive index fields through which rays are traced: meshes, uniform grids, bodies, and resampling."""

from .averages.rows_of_cells import AveragesLacking
from .bodies.body import Body
from .bodies.solid_body import SolidBody
from .field import GroupIndex, IndexField, Upstream
from .mesh import QuadMesh
from .resample import ResamplingError

__all__ = [
    "AveragesLacking",
    "Body",
    "GroupIndex",
    "IndexField",
    "QuadMesh",
    "ResamplingError",
    "SolidBody",
    "Upstream",
]
