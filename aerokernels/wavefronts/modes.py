"""Zernike coefficients and their table, structure function and centroid of a wavefront."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..display.quantities import Quantity
from ..display.shown import drawn_on, shown
from ..files.writing import replacing
from ..inputs.arguments import checked
from ..inputs.checks import check_count
from ..zernike import noll_to_nm, zernike_modes
from .changes import of_changes, of_map
from .pixels import derivatives
from .terms import weighted_mean
from .transfer import autocorrelation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Parts of a ring of pairs of pixels that are compared.
PARTS = 4
# Singular values below this share of the greatest one are nil: polynomials that the samples do not tell apart.
LEAST_SINGULAR = 1e-9
# Names by azimuthal order, and what precedes them by the place among those of that order.
FAMILIES = {0: "spherical", 1: "coma", 2: "astigmatism", 3: "trefoil", 4: "quadrafoil", 5: "pentafoil", 6: "hexafoil"}
RANKS = ("", "secondary ", "tertiary ", "quaternary ", "quinary ")


@shown
@dataclass(frozen=True, eq=False)
class StructureFunction:
    """Mean square difference of the OPD over pairs of points, by their distance.

    Attributes:
        separation: Distance of the points [m], shape (n,), ascending.
        value: <(OPD(x) - OPD(x + r))^2> [m2], shape (n,).
        pair_weight: Weight of the pairs behind each value, shape (n,); sums to 1.
        errors: Function that returns the error of each value [m2], shape (n,); `error` calls it.
    """

    separation: np.ndarray
    value: np.ndarray
    pair_weight: np.ndarray
    errors: Callable[[], np.ndarray] | None = field(default=None, repr=False)

    @cached_property
    def error(self) -> np.ndarray:
        """Error of each value [m2], shape (n,); NaN if it is not known. Computed when first read."""
        return np.full(np.shape(self.value), np.nan) if self.errors is None else self.errors()

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the square root of the function [nm] over the distance on matplotlib axes; return the axes."""
        axes = drawn_on(axes)
        axes.plot(1e3 * self.separation, 1e9 * np.sqrt(self.value))
        if np.isfinite(self.error).all():
            high = 1e9 * np.sqrt(self.value + self.error)
            low = 1e9 * np.sqrt(np.maximum(self.value - self.error, 0.0))
            axes.fill_between(1e3 * self.separation, low, high, alpha=0.3)
        axes.set(xlabel="distance [mm]", ylabel="root of the structure function [nm]")
        return axes


@checked
def zernike(wavefront: Any, count: int) -> np.ndarray:
    """Return the coefficients [m] of the first `count` Zernike polynomials, Noll's index 1 first, shape (count,).

    The polynomials have rms 1 over the disc of `radius` (zernike.py) and are fitted together by weighted least squares:
    on a pupil that is not a disc they are not orthogonal. `zernike_errors` gives the error of each coefficient.

    Raises:
        ValueError: A count below 1, or more polynomials than the pupil's samples can distinguish.
    """
    count = check_count(count, "count")
    opd, weight = wavefront.samples
    most = len(opd)
    if count <= most:
        basis, root = _weighted_modes(wavefront, count), np.sqrt(weight)
        found, _, most, _ = np.linalg.lstsq(basis, opd * root, rcond=LEAST_SINGULAR)
    if most < count:
        raise ValueError(
            f"the pupil's {len(opd)} samples cannot distinguish {count} Zernike polynomials, only {most} at most: take "
            "fewer, or a greater pixel_count"
        )
    return np.asarray(found)


@checked
def zernike_errors(wavefront: Any, count: int) -> np.ndarray:
    """Return the error of each Zernike coefficient [m], shape (count,).

    Each is fitted again to maps that changed, and to finer pixels (changes.py). NaN if that is not known; infinite if
    the pupil's samples cannot distinguish the polynomials.

    Raises:
        ValueError: A count below 1.
    """
    count = check_count(count, "count")
    solved: dict[float, np.ndarray] = {}

    def number(wave: Any) -> np.ndarray:
        opd, weight = wave.samples
        if wave.pixel not in solved:
            solved[wave.pixel] = np.linalg.pinv(_weighted_modes(wave, count), LEAST_SINGULAR)
        return np.asarray(solved[wave.pixel] @ (opd * np.sqrt(weight)))

    if count > len(wavefront.points):
        return np.full(count, np.inf)
    size = np.linalg.svd(_weighted_modes(wavefront, count), compute_uv=False)
    return np.full(count, np.inf) if size[-1] <= LEAST_SINGULAR * size[0] else of_map(wavefront, number)


def _weighted_modes(wavefront: Any, count: int) -> np.ndarray:
    """Return the Zernike polynomials at the samples times the roots of the weights, shape (lit count, count)."""
    modes = zernike_modes(count, *(wavefront.points.T / wavefront.radius))
    return np.asarray(modes.T * np.sqrt(wavefront.samples[1])[:, None])


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


def structure_function(wavefront: Any) -> StructureFunction:
    """Return the mean square OPD difference of pairs of points by their distance: every pair of pixels counts.

    D(r) = sum w w' (W - W')^2 / sum w w'. A ring has few distances and directions. The error due to them is the
    standard error of D / r^2 over four parts of the ring, by the sum of a shift's rows and columns, which are alike
    under quarter turns; and what the spread of the distances makes of a function that grows as r^2.
    """
    separation, value, share, by_rings = _rings(wavefront)
    return StructureFunction(separation, value, share, partial(_structure_errors, wavefront, by_rings))


def _structure_errors(wavefront: Any, by_rings: np.ndarray) -> np.ndarray:
    return np.asarray(np.hypot(of_changes(wavefront, lambda one: _rings(one)[1]), by_rings))


def _rings(wavefront: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return distances [m], values [m2], weights of the pairs and errors due to the rings [m2], all of shape (n,)."""
    from scipy.ndimage import uniform_filter1d

    weight = wavefront.weight
    opd, share = wavefront.samples
    flat = np.zeros(weight.shape)
    flat[wavefront.lit] = opd - weighted_mean(share, opd)  # the mean removed: less rounding
    pairs = autocorrelation(weight).real
    square, cross = autocorrelation(weight * flat**2, weight).real, autocorrelation(weight * flat).real
    total = square + square[::-1, ::-1] - 2.0 * cross
    shift = np.arange(1 - len(weight), len(weight))
    distance = np.hypot(shift[:, None], shift)
    there = pairs > 1e-9 * pairs.max()
    part = PARTS * np.rint(distance[there]).astype(int) + (np.abs(shift[:, None]) + np.abs(shift))[there] % PARTS
    counts, sums, mean, squares = (
        np.bincount(part, pairs[there] * one, 2 * PARTS * len(weight)).reshape(-1, PARTS)
        for one in (1.0, total[there] / pairs[there], distance[there], distance[there] ** 2)
    )
    kept = counts.any(axis=1)
    counts, sums, mean, squares = (one[kept] for one in (counts, sums, mean, squares))
    whole = counts.sum(axis=1)
    value = np.maximum(sums.sum(axis=1) / whole, 0.0)
    place, spread = mean.sum(axis=1) / whole, squares.sum(axis=1) / whole
    steep = np.divide(sums, squares, out=np.zeros_like(sums), where=squares > 0.0)
    rest = steep - np.divide(value, spread, out=np.zeros_like(value), where=spread > 0.0)[:, None]
    known = np.maximum(np.count_nonzero(counts, axis=1) - 1, 1)
    scatter = np.sum(counts * rest**2, axis=1) / whole / known
    # Four parts may agree by chance: three rings in a row tell.
    by_parts = spread * np.sqrt(np.maximum(scatter, uniform_filter1d(scatter, 3)))
    by_distance = value * (np.divide(spread, place**2, out=np.ones_like(spread), where=place > 0.0) - 1.0)
    return wavefront.pixel * place, value, whole / whole.sum(), np.hypot(by_parts, by_distance)


def centroid(wavefront: Any) -> np.ndarray:
    r"""Return the centroid of the point spread function along x and y [rad], shape (2,): the mean slope of the OPD.

    By Parseval's theorem the centroid of the PSF is \int |A|^2 grad OPD / \int |A|^2, A being the amplitude in the
    pupil; slopes are differences of neighbouring pixels. NaN where no pixel has a neighbour.
    """
    opd, share = wavefront.samples
    lit, flat, found = wavefront.lit, np.zeros(wavefront.opd.shape), []
    flat[lit] = opd - weighted_mean(share, opd)
    for axis in (1, 0):
        beside = np.pad(lit, 1)
        beside = (np.roll(beside, 1, axis) | np.roll(beside, -1, axis))[1:-1, 1:-1]
        intensity = np.where(beside, np.asarray(wavefront.intensity), 0.0)
        total = intensity.sum()
        slope = np.sum(intensity * derivatives(flat, lit, axis)[0])
        found.append(slope / (wavefront.pixel * total) if total > 0.0 else np.nan)
    return np.array(found)
