"""Refractive index fields through which rays are traced: meshes, uniform grids, bodies, and resampling."""

from aerokernels.medium.bodies.body import Body
from aerokernels.medium.bodies.solid_body import SolidBody
from aerokernels.medium.field import GroupIndex, IndexField, Upstream
from aerokernels.medium.mesh import QuadMesh
from aerokernels.medium.resample import ResamplingError

__all__ = [
    "Body",
    "GroupIndex",
    "IndexField",
    "QuadMesh",
    "ResamplingError",
    "SolidBody",
    "Upstream",
]
