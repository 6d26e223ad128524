"""Refractive index fields through which rays are traced: meshes, uniform grids, bodies, and resampling."""

from .body import Body
from .field import IndexField, Upstream
from .mesh import QuadMesh
from .resample import ResamplingError
from .rows_of_cells import AveragesLacking
from .solid_body import SolidBody

__all__ = ["AveragesLacking", "Body", "IndexField", "QuadMesh", "ResamplingError", "SolidBody", "Upstream"]
