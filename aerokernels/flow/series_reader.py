"""Read the files of a series one by one, with one ambient density for all of them."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ..inputs.wavelength import DEFAULT_WAVELENGTH
from .density_field import CellDensity, DensityField
from .models import refractivity_model
from .sampled_density import GridDensity, VertexDensity

OF_SAMPLES_ALONE = CellDensity, VertexDensity, GridDensity

# A difference of the far field is that of another flow if it is this many times the scatter of the densities there, and
# changes the optical path by more than the default tolerance [waves].
SCATTERS, WORTH = 3.0, 1e-3
SHARES = (0.16, 0.5, 0.84)  # quantiles: the median, and half of the distance of the others as the scatter
SAMPLES = 1 << 17  # of the upstream end, about


def with_own(found: Any, own: Mapping[str, Any]) -> Any:
    """Return a density field with attributes in place of its own, by name; anything else as it is.

    Raises:
        ValueError: The field is a formula.
    """
    if not own or not isinstance(found, DensityField):
        return found
    if type(found) not in OF_SAMPLES_ALONE:
        what = f"a {type(found).__name__} is a formula, which has its own {', '.join(own)}"
        raise ValueError(f"{what}: leave it out, and make the fields with the values that they are to have")
    return replace(found, **own)  # type: ignore[type-var]


class SeriesReader:
    """Reads files, or one file at several times, as density fields; the first one read is the first snapshot.

    All files get the ambient density of the first one, unless the caller gives it or a function that reads them. That
    of each file would be the median of its own turbulence: on lines of unequal length through the grid its fluctuations
    would tilt the wavefront. A file of other flow conditions has a far field that differs by more than turbulence, and
    gets a warning.

    Attributes:
        options: The options of `flow.read`; None where the caller's function reads.
    """

    def __init__(self, read: Callable[..., DensityField] | None, options: dict[str, Any], own: Mapping[str, Any]):
        """Store the function, its options, and attributes that replace those of the fields."""
        self.options: dict[str, Any] | None = None
        self._read: Any
        if read is None:
            self._read = import_module("aerokernels.flow.reading.read").Reader(**options)
            self.options = self._read.options
        else:
            self._read = partial(read, **options)
        self._own, self._first = own, np.empty(0)
        self._is_watched = read is None and "ambient_density" not in options

    def __call__(self, path: Path, **more: Any) -> DensityField:
        """Read a file, or a time of it. Errors as in `flow.read`."""
        found = self._read(path, **more)
        if self._is_watched:
            self._watch(path, found)
        changed: DensityField = with_own(found, self._own)
        return changed

    def _watch(self, path: Path, found: DensityField) -> None:
        """Hold the ambient density of the first file, and warn of the first other one with another far field."""
        assert self.options is not None
        front = import_module("aerokernels.flow.reading.read").far_field(found, self._read.resampling)
        low, middle, high = np.quantile(front[:: max(1, front.size // SAMPLES)], SHARES)
        here = np.array([middle, 0.5 * (high - low)])
        if not self._first.size:
            self.options["ambient_density"], self._first = found.ambient_density, here
            return
        difference, scatter = abs(here[0] - self._first[0]), max(here[1], self._first[1])
        length = float(found.box[1][-1] - found.box[0][-1])
        constant = float(refractivity_model("gladstone-dale").constant(DEFAULT_WAVELENGTH))
        waves = constant * difference * length / DEFAULT_WAVELENGTH
        if difference > SCATTERS * scatter and waves > WORTH:
            self._is_watched = False  # one warning for a series
            warn_caller(
                f"{path}: the density at its upstream end is {here[0]:.6g} kg/m3, in the first snapshot "
                f"{self._first[0]:.6g} kg/m3, but all snapshots are taken to be in air of {found.ambient_density:.6g} "
                f"kg/m3: {waves:.2g} waves along the box at {1e9 * DEFAULT_WAVELENGTH:.0f} nm. Open snapshots of "
                "different flow conditions as separate series, or give density fields, which keep their own "
                "ambient_density; if the conditions are the same, give ambient_density"
            )
