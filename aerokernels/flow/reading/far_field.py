"""The gas that flows toward a field: the samples at its upstream end."""

from typing import TYPE_CHECKING

import numpy as np

from aerokernels.flow.density_field import CellDensity, DensityField
from aerokernels.flow.sampled_density import GridDensity, VertexDensity

if TYPE_CHECKING:
    from aerokernels.flow.reading.volumes.resampling import Resampling


def front_of(places: np.ndarray) -> np.ndarray:
    """Return which places, shape (n, d), are in the most upstream twentieth of all."""
    return np.asarray(places[:, -1] >= float(np.quantile(places[:, -1], 0.95)))


def far_field(flow: DensityField, resampling: "Resampling | None" = None) -> np.ndarray | None:
    """Return the densities at the upstream end of a field [kg/m3], shape (n,); None where it has no samples.

    `flow.read` takes their median for the ambient density of a file that states none. `resampling` is the map by which
    a volume was made from cells: nodes in no cell do not count.
    """
    if isinstance(flow, GridDensity):
        if resampling is not None and resampling.shape == flow.density.shape:
            return flow.density.reshape(-1)[resampling.front]
        return flow.density[..., -1].ravel()
    if isinstance(flow, (CellDensity, VertexDensity)):
        places = flow.mesh.cell_centroid if isinstance(flow, CellDensity) else flow.mesh.vertices
        return flow.density[front_of(places)]
    return None
