"""Read snapshots of a mixture of gases from a file with a time axis: fractions of each species and the density."""

from typing import Any

import numpy as np

from aerokernels.flow.reading.fractions import Fractions, mass_fractions, mixture_in_words, species_arrays

from .sampled_density import GridDensity
from .series import GridMesh


class Mixture:
    """The variables of an xarray object that hold the fractions of species.

    Attributes:
        said: The variables used, in words.
        identity: The variables used, as plain JSON types.
    """

    def __init__(self, name: str, data: Any, axes: tuple[str, ...], species: Any):
        """Find the variables.

        Args:
            name: The file, for messages.
            data: The xarray object.
            axes: The time axis and the axes of the density, in the density's order.
            species: As in `flow.read`.

        Raises:
            TypeError: `species` has a wrong type.
            ValueError: An unknown species, no such variable, or a variable on other axes than the density.
        """
        if not hasattr(data, "data_vars"):
            raise ValueError(
                f"{name}: a single array has no species: give a dataset with the density and the fractions"
            )
        self._basis, self._arrays = species_arrays(name, [str(one) for one in data.data_vars], species)
        self._name, self._clock, self._shares = name, axes[0], []
        for variable in self._arrays.values():
            own = data[variable]
            if set(own.dims) not in (set(axes), set(axes[1:])):
                raise ValueError(
                    f"{name}: {variable} has axes {', '.join(map(str, own.dims))}, the density "
                    f"{', '.join(axes)}: give both on the same ones"
                )
            self._shares.append(own.transpose(*(axis for axis in axes if axis in own.dims)))
        self.said = mixture_in_words(self._basis, self._arrays)
        self.identity = [self._basis, *map(list, self._arrays.items())]

    def field(self, density: np.ndarray, where: GridMesh, ambient: float, own: dict, number: int) -> GridDensity:
        """Return the density field of a snapshot, with its composition.

        Args:
            density: [kg/m3], on the grid.
            where: The grid.
            ambient: Density around the grid [kg/m3].
            own: The body and the free stream, by name.
            number: Number of the snapshot.

        Raises:
            ValueError: Fractions that are not valid, densities that no gas has.
        """
        variables = [one.isel({self._clock: number}) if self._clock in one.dims else one for one in self._shares]
        fractions = np.stack([np.asarray(one.values, dtype=np.float64).ravel() for one in variables])
        label = f"{self._name}, snapshot {number}"
        mass = mass_fractions(label, fractions, "node", self._arrays, self._basis)
        density = np.array(density, dtype=np.float64)
        partial = (mass * density.ravel()).reshape(-1, *density.shape)
        ambient_partial = partial[..., -1].reshape(len(partial), -1).mean(axis=1)  # greatest z: the inflow
        composition = Fractions(tuple(self._arrays), [], self.said).composition(partial, ambient_partial)
        return GridDensity(
            density, where.origin, where.spacing, where.geometry, ambient, where.cell_averages,
            own["body"], own["conditions"], f"{label}; {self.said}", composition=composition,
        )  # fmt: skip
