"""Which arguments of `open_series` have a meaning for which kind of source; all others are rejected.

An argument without a meaning must not be ignored: the snapshots would have the data's own value instead.
"""

from typing import Any, NamedTuple

from ..medium import QuadMesh
from .series import GridMesh

FILES, WITH_TIME = "files that are read one by one", "data with a time axis"
ARRAYS, FIELDS = "arrays", "density fields"
# The arguments of each kind of source, apart from its times. Files take the options of their reader as well.
TAKES = {
    FILES: ("density", "ambient_density", "geometry", "spacing", "mesh", "species", "body", "conditions", "read"),
    WITH_TIME: (
        "density", "ambient_density", "geometry", "length_unit", "cell_averages", "species", "body", "conditions",
    ),
    ARRAYS: ("ambient_density", "geometry", "origin", "spacing", "mesh", "cell_averages", "body", "conditions"),
    FIELDS: ("ambient_density", "body", "conditions"),
}  # fmt: skip
TIMES = ("time", "time_step", "start_time", "count")
# Arguments that turn densities into optical paths, which a series does not.
OPTICAL = ("wavelength", "relation", "constant", "interpolation")


class Given(NamedTuple):
    """The arguments that a caller of `open_series` gives.

    Attributes:
        named: Its named arguments; None where one is not given.
        options: Further ones.
    """

    named: dict[str, Any]
    options: dict[str, Any]

    @property
    def values(self) -> dict[str, Any]:
        """All arguments that are given."""
        return {name: value for name, value in {**self.named, **self.options}.items() if value is not None}

    def check(self, source: str, kind: str) -> None:
        """Reject an argument that a kind of source has no use for.

        Args:
            source: The source, for the message.
            kind: What it was recognised as.

        Raises:
            TypeError: A name that `open_series` does not have.
            ValueError: An argument of other sources.
        """
        values = self.values
        optical = [name for name in OPTICAL if name in self.options]
        if optical and "read" not in values:
            raise TypeError(f"a series holds densities: give {optical[0]} to optical_series, or to index_field")
        unused = [name for name in values if name not in TAKES[kind] and (kind != FILES or name not in self.options)]
        if kind == FILES and isinstance(values.get("mesh"), QuadMesh):
            unused.append("QuadMesh as mesh")
        if unused:
            remedy = " (give density fields, each with its composition)" if unused[0] == "species" else ""
            raise (TypeError if unused[0] in self.options else ValueError)(
                f"{source} is taken for {kind}, which take no {unused[0]}{remedy}, but {', '.join(TIMES)}, "
                f"{', '.join(TAKES[kind])}{' and options of their reader' if kind == FILES else ''}: leave it out"
            )

    def check_geometry(self, source: str, mesh: GridMesh | QuadMesh | None) -> None:
        """Reject a geometry other than that which the source has.

        Raises:
            ValueError: They differ.
        """
        geometry = self.named["geometry"]
        if geometry is not None and mesh is not None and geometry != mesh.geometry:
            raise ValueError(f"{source} is {mesh.geometry}, not {geometry}: leave geometry out")

    def for_files(self) -> dict[str, Any]:
        """Return the options with which a file is read: `read` has these arguments under the same names."""
        names = ("density", "ambient_density", "geometry", "spacing", "mesh", "species")
        return {name: self.named[name] for name in names if self.named[name] is not None} | self.options

    def of_fields(self) -> dict[str, Any]:
        """Return the attributes that density fields get in place of their own."""
        return {name: self.named[name] for name in TAKES[FIELDS] if self.named[name] is not None}
