"""Reading snapshots on one mesh: what the mesh decides is worked out for the first, and kept for those that follow."""

from typing import Any

from ..density_field import DensityField
from .read import Kept, read_onto
from .resampling import Resampling


class Reader:
    """`flow.read` with its options given once, for files or times that share a mesh.

    A volume is drawn into its grid once; each further snapshot on the same mesh costs the reading of its file and a
    pass over cells and nodes. A file with another mesh is drawn anew, and its map kept from then on.

        reader = flow.Reader(spacing=1e-3)
        fields = [reader("case", time=t) for t in (0.1, 0.2, 0.3)]
        field = reader.resampling.apply(densities)  # of the same cells, from a solver in this process
    """

    def __init__(self, **options: Any):
        """Keep the options, which are those of `flow.read`."""
        self.options, self._kept = options, Kept()

    def __call__(self, path, **more: Any) -> DensityField:
        """Read a file or case; `more` goes before the options. Errors as in `flow.read`."""
        return read_onto(self._kept, path, **{**self.options, **more})

    @property
    def resampling(self) -> Resampling | None:
        """The map from the mesh of the last volume to its grid; None before the first, and for other flows."""
        return self._kept.found
