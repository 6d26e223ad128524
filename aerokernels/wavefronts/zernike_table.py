"""A table of Zernike coefficients: Noll's index, orders, usual name, coefficient and its error."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..display.quantities import Quantity
from ..files.writing import replacing
from ..inputs.arguments import checked
from ..zernike import noll_to_nm
from .modes import zernike, zernike_errors

FAMILIES = {0: "spherical", 1: "coma", 2: "astigmatism", 3: "trefoil", 4: "quadrafoil", 5: "pentafoil", 6: "hexafoil"}
RANKS = ("", "secondary ", "tertiary ", "quaternary ", "quinary ")


def usual_name(n: int, m: int) -> str:
    """Return the usual name of the polynomial of order (n, m): "coma x", "secondary astigmatism 45 deg"."""
    size = abs(m)
    if n < 2 or (n, m) == (2, 0):
        return {0: "piston", 1: "tilt x" if m > 0 else "tilt y", 2: "defocus"}[n]
    rank = n // 2 - 2 if m == 0 else (n - 3) // 2 if size == 1 else (n - size) // 2
    name = f"{RANKS[rank] if rank < len(RANKS) else f'order {rank + 1} '}{FAMILIES.get(size, f'{size}-foil')}"
    return name + ("", " x", " y")[m] if size < 2 else f"{name} {0.0 if m > 0 else 90.0 / size:.3g} deg"


@dataclass(frozen=True)
class ZernikeTerm:
    """One row of a table: Noll's index, radial order n, azimuthal order m (negative for sines), usual name.

    `value` is the coefficient [m] of the polynomial of rms 1 over the unit disc, `error` its error [m], NaN if it is
    not known. An angle in the name is the azimuth of a maximum, from x toward y.
    """

    index: int
    n: int
    m: int
    name: str
    value: float
    error: float


class ZernikeTable(tuple[ZernikeTerm, ...]):
    """The rows, a tuple of ZernikeTerm that prints as a table in nanometers."""

    __slots__ = ()

    def __repr__(self) -> str:
        """The table, the coefficients in nanometers."""
        lines = [f"{'Noll':>4} {'n':>3} {'m':>4}  {'name':<30}  coefficient"]
        for one in self:
            number = Quantity(one.value, one.error, "m").scaled(1e9, "nm").text(signed=True)
            lines.append(f"{one.index:>4} {one.n:>3} {one.m:>4}  {one.name:<30}  {number}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{self!r}</pre>"

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame of the rows by Noll's index; value and error are in meters."""
        from pandas import DataFrame

        return DataFrame([asdict(one) for one in self]).set_index("index")

    def to_csv(self, path: str | Path) -> None:
        """Write the rows as CSV with a heading, value and error in meters.

        Raises:
            ValueError: The path is a folder, or its folder does not exist.
        """
        with replacing(Path(path)) as (draft,):
            self.to_pandas().to_csv(draft)


@checked
def zernike_table(wavefront: Any, count: int) -> ZernikeTable:
    """Return the first `count` Zernike coefficients as a table: index, n, m, name, value [m] and error [m].

    Values are those of `zernike`, errors those of `zernike_errors`; both raise its errors. `table[7].name` is "coma x",
    `table.to_csv("zernike.csv")` writes a file.
    """
    rows = zip(map(float, zernike(wavefront, count)), map(float, zernike_errors(wavefront, count)), strict=True)
    orders = (noll_to_nm(index) for index in range(1, count + 1))
    terms = enumerate(zip(orders, rows, strict=True), start=1)
    return ZernikeTable(ZernikeTerm(index, *order, usual_name(*order), *row) for index, (order, row) in terms)
