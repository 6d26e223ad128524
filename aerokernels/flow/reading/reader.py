"""Read snapshots on one mesh: what depends on the mesh alone is computed once and reused for all snapshots."""

from typing import Any

from aerokernels.flow.density_field import DensityField
from aerokernels.flow.reading.read import SharedMesh, read_onto
from aerokernels.flow.reading.volumes.resampling import Resampling


class Reader:
    """`flow.read` with its options given once, for files or times that share a mesh.

    The map from the mesh of a volume to its grid is computed once; each further snapshot on the same mesh costs the
    reading of its file and one pass over cells and nodes. A file with another mesh gets a new map, which replaces the
    previous one.

        reader = flow.Reader(spacing=1e-3)
        fields = [reader("case", time=t) for t in (0.1, 0.2, 0.3)]
        field = reader.resampling.apply(densities)  # of the same cells, from a solver in this process
    """

    def __init__(self, **options: Any):
        """Store the options, which are those of `flow.read`."""
        self.options, self._shared = options, SharedMesh()

    def __call__(self, path, **more: Any) -> DensityField:
        """Read a file or case; `more` overrides the stored options. Errors as in `flow.read`."""
        return read_onto(self._shared, path, **{**self.options, **more})

    @property
    def resampling(self) -> Resampling | None:
        """The map from the mesh of the last volume to its grid; None before the first and for other geometries."""
        return self._shared.resampling
