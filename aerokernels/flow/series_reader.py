"""Read the files of a series one by one, with one ambient density for all of them."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from .density_field import CellDensity, DensityField
from .sampled_density import GridDensity, VertexDensity

OF_SAMPLES_ALONE = CellDensity, VertexDensity, GridDensity


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
    would tilt the wavefront.

    Attributes:
        options: The options of `flow.read`; None where the caller's function reads.
    """

    def __init__(self, read: Callable[..., DensityField] | None, options: dict[str, Any], own: Mapping[str, Any]):
        """Store the function, its options, and attributes that replace those of the fields."""
        self.options: dict[str, Any] | None = None
        self._read: Any
        if read is None:
            self._read = import_module(f"{__package__}.reading.reader").Reader(**options)
            self.options = self._read.options
        else:
            self._read = partial(read, **options)
        self._own = own

    def __call__(self, path: Path, **more: Any) -> DensityField:
        """Read a file, or a time of it. Errors as in `flow.read`."""
        found = self._read(path, **more)
        if self.options is not None and isinstance(found, DensityField):
            self.options.setdefault("ambient_density", found.ambient_density)
        changed: DensityField = with_own(found, self._own)
        return changed
