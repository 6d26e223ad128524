r"""Response of an interferometer to a field or a series of fields.

    visibility exp(i phase) = sum over rays of share exp(i (phi_1 - phi_2)),     phi of the rays of the two beams

Deflection is neglected: over the few millimetres around a focus it displaces rays by less than a waist.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..display.shown import drawn_on
from ..flow import DensityField, Series
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_count, warn_caller
from ..inputs.kinds import wrong_kind
from ..medium import IndexField
from ..rays import RayBundle
from ..tracing.cuts import lost
from ..tracing.lines import cell_along
from ..tracing.pupil.air import GREATEST_SHARE, TruncationWarning
from ..tracing.some_pixels import STUDENT, total
from ..tracing.stop import Plane
from ..tracing.variants.causes import line_variants, of_each
from ..tracing.variants.paths import Paths, Rays, paths_of
from .instrument import BEYOND_REACH, FLDI, REACH, beam_grid, crossed, gathered, ray_points, truncated_share

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class FLDIResponse:
    """Response of an instrument; arrays have shape (time_count, offset_count) without axes not requested.

    Attributes:
        phase: Phase difference of the detected light [rad], positive where the first beam, the one toward the
            instrument's direction, is delayed; NaN where a body blocks all of the light of either beam.
        visibility: Contrast of the interference, 1 where all rays have the same phase; light whose counterpart is
            blocked by a body reduces it.
        mean_phase: Mean phase difference weighted by light [rad], linear in the field.
        error: Error of the phase [rad]: the root sum of squares of the field's and of the sampling of
            the beams, which is the change with half as many rays in both directions, the greater change with a half and
            a third of the layers along them, and the effect of the light beyond the outermost rays. NaN where the phase
            is NaN, and for a resampled field whose source was not kept.
        truncated: Share of the light through disturbed air that was cut off the field; the phase includes only the
            known part of that air.
        time: Times [s], shape (time_count,), or None for one field.
        instrument: The instrument.
    """

    phase: np.ndarray
    visibility: np.ndarray
    mean_phase: np.ndarray
    error: np.ndarray
    truncated: np.ndarray
    time: np.ndarray | None
    instrument: FLDI

    @checked
    def signal(self, bias: float = 0.5 * np.pi) -> np.ndarray:
        """Return the light on a detector over its maximum, (1 + visibility cos(phase - bias)) / 2."""
        if not np.isfinite(bias):
            raise ValueError(f"bias must be a finite phase [rad], got {bias!r}")
        return 0.5 * (1.0 + self.visibility * np.cos(self.phase - bias))

    @checked
    def spectrum(self, segment: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies [Hz] and the power spectral density of the phase [rad2 / Hz], by Welch's method.

        Raises:
            ValueError: The response is not one of a series, or its times are not evenly spaced.
        """
        if self.time is None or len(self.time) < 4:
            raise ValueError("a spectrum needs the response to a series of at least 4 snapshots")
        step = np.diff(self.time)
        if np.ptp(step) > 1e-6 * step.mean():
            raise ValueError("a spectrum needs snapshots at even times")
        if segment is not None and not 4 <= segment <= len(self.time):
            raise ValueError(f"segment must be from 4 to the {len(self.time)} snapshots, got {segment!r}")
        from scipy.signal import welch

        length = min(256, len(self.time)) if segment is None else segment
        frequency, power = welch(self.phase, 1.0 / step.mean(), nperseg=length, axis=0)
        return np.asarray(frequency), np.asarray(power)

    def to_xarray(self) -> "xarray.Dataset":
        """Return the response as a dataset with units."""
        import xarray

        names = [] if self.time is None else ["time"]
        dims = tuple(names + ["offset"] * (self.phase.ndim - len(names)))
        words = {
            "phase": ("rad", "phase difference of the detected light"),
            "visibility": ("1", "contrast of the interference"),
            "mean_phase": ("rad", "mean phase difference"),
            "error": ("rad", "error of the phase"),
            "truncated": ("1", "share of the light through air that was cut off"),
        }
        variables = {
            name: (dims, getattr(self, name), {"units": unit, "long_name": text})
            for name, (unit, text) in words.items()
        }
        coordinates = {} if self.time is None else {"time": ("time", self.time, {"units": "s"})}
        numbers = {"separation_m": "separation", "waist_m": "waist", "divergence_rad": "divergence"}
        attributes = {name: getattr(self.instrument, own) for name, own in numbers.items()}
        attributes["wavelength"] = self.instrument.wavelength
        return xarray.Dataset(variables, coordinates, attributes)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the phase on matplotlib axes, over time if there is one; return the axes."""
        axes = drawn_on(axes)
        place = np.arange(len(np.atleast_1d(self.phase))) if self.time is None else 1e6 * self.time
        axes.plot(place, np.atleast_1d(self.phase))
        axes.set(xlabel="offset number" if self.time is None else "time [us]", ylabel="phase [rad]")
        return axes

    def __repr__(self) -> str:
        """Number of phases, their rms and error."""
        seen = np.isfinite(self.phase)
        if not seen.any():
            return f"FLDIResponse of {self.phase.size} phases, none of which is known: a body blocks the light"
        size, error = float(np.sqrt(np.mean(self.phase[seen] ** 2))), float(np.max(self.error[seen]))
        share = 100.0 * float(np.max(self.truncated))
        beyond = f"; up to {share:.3g} % of the light goes through air that was cut off" if share > 0.0 else ""
        return f"FLDIResponse of {self.phase.size} phases: {size:.4g} rad rms, each to {error:.2g} rad{beyond}"


@checked
def fldi_response(
    field: IndexField | DensityField | Series | Iterable[IndexField],
    instrument: FLDI,
    *,
    offsets: Numbers | None = None,
    time: Numbers | None = None,
    rays: int | None = None,
    **relation: Any,
) -> FLDIResponse:
    """Compute the phase measured by a focused laser differential interferometer.

    Args:
        field: A field, a series of density fields, or several fields in order of time.
        instrument: The instrument.
        offsets: Displacements of the instrument's focus [m], shape (n, 3): a scan, or a frozen flow that drifts past.
        time: Times of several fields [s]; None numbers them.
        rays: Rays across a beam; None takes as many as the field's samples need, up to 192.
        **relation: Arguments of `index_field` for a density field or a series: relation, constant, composition ...

    Raises:
        TypeError: An argument is of the wrong type.
        ValueError: A number is out of range, the beams do not meet the field, or the wavelength is not the field's.

    Warns:
        TruncationWarning: More than a thousandth of the light goes through disturbed air that was cut off the field;
            `truncated` is the share.
    """
    if not isinstance(instrument, FLDI):
        raise TypeError(f"instrument must be an FLDI, got {type(instrument).__name__}")
    if rays is not None:
        rays = check_count(rays, "rays", 3, 2048)
    moved = np.zeros((1, 3)) if offsets is None else np.atleast_2d(np.asarray(offsets, dtype=np.float64))
    if moved.ndim != 2 or moved.shape[1] != 3 or not np.isfinite(moved).all():
        raise ValueError(f"offsets must be finite, shape (n, 3), got shape {np.asarray(offsets).shape}")
    if time is not None and isinstance(field, (Series, IndexField, DensityField)):
        raise ValueError("time is only for several fields: a series has its own, and a single field has none")
    times: np.ndarray | None = None
    fields: list[Any] | Iterable[Any]
    if isinstance(field, Series):
        times, fields = np.asarray(field.time), (field[number] for number in range(len(field)))
    elif isinstance(field, (IndexField, DensityField)):
        fields = [field]
    elif not isinstance(field, Iterable):
        raise wrong_kind(field, "field", "an IndexField, a DensityField, a Series or several fields")
    else:
        fields = list(field)
        times = np.arange(len(fields), dtype=np.float64) if time is None else np.asarray(time, dtype=np.float64)
        if times.shape != (len(fields),):
            raise ValueError(f"time must have one entry for each of the {len(fields)} fields")
        if not (np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
            raise ValueError("times of fields must be finite and increase")
    result = [_read(one, instrument, moved, rays, relation) for one in fields]
    if not result:
        raise ValueError("no field was given")
    arrays = np.stack(result)  # time, offset, quantity
    lost_share = float(arrays[..., -1].max())
    if lost_share > GREATEST_SHARE:
        text = (
            f"{100.0 * lost_share:.3g} % of the light goes through disturbed air that was cut off the field, and is in "
            "no error; give the field a larger region there, move the focus or turn the axis"
        )
        warn_caller(text, TruncationWarning)
    if offsets is None:
        arrays = arrays[:, 0]
    if times is None:
        arrays = arrays[0]
    phase, visibility, mean, error, truncated = np.moveaxis(arrays, -1, 0)
    return FLDIResponse(phase, visibility, mean, error, truncated, times, instrument)


def _read(field: Any, instrument: FLDI, offsets: np.ndarray, rays: int | None, relation: dict[str, Any]) -> np.ndarray:
    """Return phase, visibility, mean phase, error and truncated share for each offset, shape (n, 5)."""
    source = field
    if isinstance(field, DensityField):
        index = field.index_field(wavelength=instrument.wavelength, **relation)
        field = index if index.is_uniform else index.resample(tolerance=1e-3)
    if not isinstance(field, IndexField):
        raise wrong_kind(field, "field", "an IndexField, a DensityField or a Series")
    if source is field and relation:
        raise TypeError(
            f"fldi_response has no argument {next(iter(relation))!r} for an index field: it takes offsets, time and "
            "rays; a density field or a series also takes the arguments of `index_field`"
        )
    field.wavelength_for(instrument.wavelength)
    rows: list[tuple[float, ...]] = []
    seen: list[tuple[int, np.ndarray, tuple[float, float]]] = []
    met = False
    for focus in instrument.focus + offsets:
        ends = crossed(field, instrument, focus)
        if ends is None:
            rows.append((0.0, 1.0, 0.0, 0.0, truncated_share(field, instrument, focus, None, REACH)))
            continue
        met = True
        places, share, coarse = beam_grid(field, instrument, ends, rays)
        (first, second), passes = gathered(field, instrument, places, focus, ends)
        beyond = truncated_share(field, instrument, focus, ends, REACH)
        per_metre = 2.0 * np.pi / instrument.wavelength
        difference = per_metre * (first - second)
        both, lit = passes.all(axis=0), passes.mean(axis=0)
        if not share @ both > 0.0:  # a body blocks one beam, or both
            rows.append((np.nan, 0.0, np.nan, np.nan, beyond))
            continue
        whole, half = ((light * both * np.exp(1j * difference)).sum() for light in (share, coarse))
        whole /= float(share @ lit)
        mean = float(share @ (both * difference)) / float(share @ both)
        # Beyond half a turn the phase follows the mean: a detector counts fringes.
        phase = float(np.angle(whole))
        phase += 2.0 * np.pi * np.rint((mean - phase) / (2.0 * np.pi))
        error = abs(np.angle(half / whole)) if whole and half else np.nan
        error += BEYOND_REACH * float(np.ptp(difference[both]))
        few = np.flatnonzero(coarse * both)
        if len(few):  # with layers twice and three times as thick: one change alone may vanish by chance
            changes = []
            for coarser in (2, 3):
                (first, second), _ = gathered(field, instrument, places[few], focus, ends, coarser=coarser)
                changes.append(coarse[few] @ (per_metre * (first - second) - difference[few]))
            error += float(np.abs(changes).max()) / float(coarse[few].sum())
        seen.append((len(rows), focus, ends))
        rows.append((phase, abs(whole), mean, error, beyond))
    if not met:
        raise ValueError("the beams do not meet the field: check the focus, the axis and the units (metres)")
    result = np.asarray(rows)
    if seen:
        number, places, ways = (np.asarray(column) for column in zip(*seen, strict=True))
        # The fourth column is the error.
        result[number, 3] = np.hypot(result[number, 3], field_errors(field, instrument, places, ways))
    return result


# Places of the focus at which the phase is computed again, the nearest of them by which an error is found, and rays
# along both sides of a beam: Gauss's points for its light.
PLACES, NEAR, ACROSS = 12, 12, 4


def field_errors(field: IndexField, instrument: FLDI, focus: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the errors of phases at foci (n, 3) due to the field [rad], shape (n,); NaN where they are not known.

    `ends` are the distances from each focus between which light is in the field's box [m], shape (n, 2).
    """
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(0)
    some = np.resize(rng.permutation(len(focus))[:PLACES], PLACES)
    assert instrument.direction is not None and instrument.normal is not None  # set when it was made
    sides = np.stack([instrument.direction, instrument.normal])
    cells = cell_along(field, sides)
    cells = np.where(np.isfinite(cells), cells, 0.0)  # a planar field is the same everywhere along x
    moved = focus[some] + (rng.random((PLACES, 2)) - 0.5) * cells @ sides
    root, share = np.polynomial.hermite.hermgauss(ACROSS)
    places = np.stack(np.meshgrid(root, root), axis=-1).reshape(-1, 2) / np.sqrt(2.0)
    weight = np.outer(share, share).ravel() / share.sum() ** 2
    parts = [
        _paths(field, instrument, places, one, side, (float(begin), float(end)))
        for one, (begin, end) in zip(moved, ends[some], strict=True)
        for side in (0.5, -0.5)
    ]
    paths = Paths.joined([part[0] for part in parts])
    missed = np.concatenate([part[1] for part in parts])
    signs = 2.0 * np.pi / instrument.wavelength * np.array([1.0, -1.0])

    def phase(rays: Rays) -> np.ndarray:
        path = rays.opd.reshape(PLACES, 2, -1, len(weight)).sum(axis=2)
        return np.asarray(path @ weight @ signs)

    _, near = cKDTree(moved).query(focus, NEAR)
    return STUDENT * total(of_each(phase, line_variants(field, paths, missed), near))


def _paths(
    field: IndexField, instrument: FLDI, places: np.ndarray, focus: np.ndarray, side: float, ends: tuple[float, float]
) -> tuple[Paths, np.ndarray]:
    """Return the ways of a beam's rays to the plane of the focus and on, in turn, and what cuts leave out."""
    middle = np.clip(0.0, *ends)
    stops = [
        ray_points(instrument, places, focus, side, np.full((1, len(places)), place))[0]
        for place in (ends[0], middle, ends[1])
    ]
    result, missed = [], []
    for begin, end in pairwise(stops):
        way = end - begin
        way = np.where(np.linalg.norm(way, axis=1, keepdims=True) > 0.0, way, instrument.axis)
        rays, until = RayBundle(begin, way), Plane(end[0], instrument.axis)
        result.append(paths_of(field, rays.position, rays.direction, until))
        outward = rays if end is stops[2] else RayBundle(end, -way)
        missed.append(lost(field, outward, None))
    return Paths.joined(result), np.concatenate(missed)
