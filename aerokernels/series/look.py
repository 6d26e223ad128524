r"""Maps over look angles: the optics of a pupil that is turned about its centre, for each direction.

    direction = (sin(azimuth) cos(elevation), sin(elevation), cos(azimuth) cos(elevation))

Errors are computed for a few directions, spread over the map and its range of OPD rms; each other one takes those of
the nearest by direction and by the decimal logarithm of its rms, with a sampling error of its own.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.inputs.checks import warn_caller
from aerokernels.tracing.tasks.quadrature import asymmetry

from ..display.progress import Progress, shows_progress
from ..flow import DensityField, Series
from ..focus.estimate import PreparedStrehl
from ..focus.ratio import NoRayArrived
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import DEFAULT_WAVELENGTH
from ..inputs.kinds import shown, wrong_kind
from ..medium import IndexField
from ..pupils import direction_of
from ..rays import RayBundle
from ..tracing.cuts import flow_ends
from ..tracing.lines import NoRayMeetsField
from ..wavefronts.terms import NUMBERS

if TYPE_CHECKING:
    import xarray

ALIKE = 12  # decimals of the cosine with the axis to which directions count as equal in a symmetric flow
COVERS = "it covers the truth in 95 of 100 cases"
WITH_ERRORS = {
    "strehl": ("1", "Strehl ratio"),
    "opd_rms": ("m", "optical path difference, rms over the pupil"),
    "boresight": ("rad", "boresight error"),
    "boresight_azimuth": ("rad", "boresight error along growing azimuth"),
    "boresight_elevation": ("rad", "boresight error along growing elevation"),
}
VARIABLES = {
    **WITH_ERRORS,
    **{f"{name}_error": (units, f"error of {name}; {COVERS}") for name, (units, _) in WITH_ERRORS.items()},
    "strehl_standard_error": ("1", "standard error of its sampling"),
    "blocked": ("1", "share of the pupil that the body shades"),
    "known": (
        "1",
        "0 where the computed flow ends in disturbed air before the light, or no light arrives; 1 elsewhere",
    ),
}


@dataclass(eq=False)
class Look:
    """What is known of a direction."""

    numbers: dict[str, float]  # "strehl", "strehl_standard_error", "opd_rms" [m], "blocked" and "known"
    axes: np.ndarray  # the pupil's two axes, shape (2, 3)
    tilt: np.ndarray  # the beam's deflection along them [rad], shape (2,)
    met: bool  # whether the pupil looks through the flow
    sampling: np.ndarray  # errors of PupilNumbers' numbers by the number of rays, shape (5,)
    model: Callable[[], np.ndarray] | None = None  # computes those by all other causes, shape (5,)


@shows_progress("look angles")
@checked
def look_map(
    field: IndexField | DensityField | Series,
    azimuth: Numbers,
    elevation: Numbers,
    pupil: Any,
    *,
    wavelength: float | None = None,
    relation: str | None = None,
    constant: float | None = None,
    ray_count: int = 4096,
    tolerance: float = 1e-3,
    remove=("piston",),
    backend: str = "auto",
    device: str | None = None,
    precision: str = "float32",
    progress: Progress | None = None,
) -> "xarray.Dataset":
    """Return OPD, boresight error and Strehl ratio of a pupil over its look angles.

    The pupil keeps its centre, and its normal is turned. In a flow that is symmetric about the axis, with a round pupil
    centred on it, directions at the same angle from the axis are equivalent: each such angle is traced once.

    Args:
        field: The refractive index, or a density field or a series from which the index is computed.
        azimuth: Angles [rad], shape (n,), from -pi to pi: toward +x.
        elevation: Angles [rad], shape (m,), from -pi/2 to pi/2: toward +y.
        pupil: The pupil, in any direction.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm.
        relation: Density to index, see `flow.refractivity_model`; likewise `constant`.
        constant: K [m3/kg].
        ray_count: Rays over the pupil.
        tolerance: Requested OPD error [waves].
        remove: Terms removed from the wavefront: "piston", "tilt".
        backend: See `trace`; likewise `device` and `precision`.
        device: Device of the backend.
        precision: "float32" or "float64".
        progress: Called with a description of the progress and its share; None shows a bar in terminals and notebooks.

    Returns:
        A dataset (azimuth, elevation), with `time` before them for a series: `strehl`, `opd_rms` [m], `boresight`,
        `boresight_azimuth` and `boresight_elevation` [rad], each with its error (`strehl_error` and so on), which
        covers the truth in 95 of 100 cases and is computed for a few directions,
        `strehl_standard_error`, the part of the sampling in that of `strehl`, `blocked`, the share in the body's
        shadow, and `known`: 1, or 0 along which more than a thousandth of the pupil looks through disturbed air that
        was cut off, or more than a hundredth past the field's box, so that the numbers lack that air, or where the
        whole pupil is in the shadow, so that they are NaN. The attribute `ends` says where the flow itself ends in
        disturbed air, which the numbers take as the whole of it.

    Raises:
        TypeError: A field or a pupil of the wrong kind.
        ValueError: Angles that are not finite or out of range, an invalid option, or a pupil from which no direction
            leads through the flow.
    """
    angles = [_angles("azimuth", azimuth, np.pi), _angles("elevation", elevation, 0.5 * np.pi)]
    if not (hasattr(pupil, "center") and hasattr(pupil, "normal")):
        raise wrong_kind(pupil, "pupil", "a Disc or another pupil")
    options: dict[str, Any] = {"ray_count": ray_count, "tolerance": tolerance, "remove": remove}
    options |= {"backend": backend, "device": device, "precision": precision}
    length = DEFAULT_WAVELENGTH if wavelength is None else wavelength
    if isinstance(field, IndexField):
        fields, times = [field], None
        options["wavelength"] = wavelength
    elif isinstance(field, DensityField):
        fields, times = [field.index_field(length, relation, constant=constant)], None
    elif isinstance(field, Series):
        fields, times = field, field.time  # type: ignore[assignment]
    else:
        raise wrong_kind(field, "field", "an IndexField, a DensityField or a Series")
    maps = []
    for number, one in enumerate(fields):
        index = one if isinstance(one, IndexField) else one.index_field(length, relation, constant=constant)
        share = (number / len(fields), 1.0 / len(fields))
        maps.append(_hemisphere(index, angles[0], angles[1], pupil, options, progress, share))
    length = wavelength if wavelength is not None and "wavelength" in options else length
    columns, rows = np.meshgrid(*angles, indexing="ij")
    looks = direction_of(columns, rows).reshape(-1, 3)
    middle = RayBundle(np.broadcast_to(pupil.center, looks.shape), looks)  # one ray a direction
    ends = flow_ends(index, middle.pilot, None, tolerance * length)
    return _dataset(maps, angles, times, pupil, length, ends)


def _angles(name: str, values: Any, most: float) -> np.ndarray:
    found = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if found.ndim != 1 or found.size == 0 or not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite angles in radians, shape (n,), got {values!r}")
    greatest = float(np.abs(found).max())
    if greatest > most * (1.0 + 1e-12):
        raise ValueError(
            f"{name} must be between -{most:.4g} and {most:.4g}, in radians, got {greatest:g}: "
            "np.radians converts degrees"
        )
    if greatest > 0.0 and (found == np.round(found)).all():
        warn_caller(f"{name} {shown(found.tolist())} is taken in radians; np.radians converts degrees")
    return found


def _hemisphere(field, azimuth, elevation, pupil, options, progress, share) -> dict[str, np.ndarray]:
    """Return the variables over (azimuth, elevation) of one field."""
    columns, rows = np.meshgrid(azimuth, elevation, indexing="ij")
    looks = direction_of(columns, rows).reshape(-1, 3)
    turned, kind = looks, np.arange(len(looks))
    ahead = replace(pupil, normal=np.array([0.0, 0.0, 1.0]))
    symmetric = asymmetry(field, ahead, ahead.normal) is None  # directions at one angle from z are equivalent
    if symmetric:
        _, first, kind = np.unique(np.round(looks[:, 2], ALIKE), return_index=True, return_inverse=True)
        height = looks[first, 2]
        turned = np.stack([np.zeros(len(first)), np.sqrt(np.maximum(1.0 - height**2, 0.0)), height], axis=1)
    found = []
    for count, look in enumerate(turned, start=1):
        found.append(_look(field, pupil, look, options))
        if progress is not None:
            progress(f"{count} of {len(turned)} directions", share[0] + share[1] * count / len(turned))
    if not any(one.met for one in found):
        low, high = field.box
        raise ValueError(
            f"the flow, whose box is {low.tolist()} to {high.tolist()} m, is before the pupil at "
            f"{pupil.center.tolist()} m in none of the {len(looks)} directions: check the units (metres are expected)"
        )
    wrong = tell_errors(found, turned)[kind]
    numbers = [one.numbers for one in found]
    tilt = np.array([one.tilt @ one.axes for one in found])[kind]
    if symmetric:
        tilt = _about_the_axis(tilt, looks)
        wrong = np.stack([_about_the_axis(wrong[:, k], looks) for k in range(2)], axis=1)
    # Unit vectors along growing azimuth and elevation.
    along = np.stack([np.cos(columns), np.zeros(columns.shape), -np.sin(columns)], axis=-1).reshape(-1, 3)
    up = np.stack([-np.sin(columns) * np.sin(rows), np.cos(rows), -np.cos(columns) * np.sin(rows)], axis=-1)
    shape = columns.shape
    maps = {name: np.array([one[name] for one in numbers])[kind].reshape(shape) for name in numbers[0]}
    maps["boresight"] = np.linalg.norm(tilt, axis=1).reshape(shape)
    maps["boresight_error"] = np.linalg.norm(wrong, axis=(1, 2)).reshape(shape)
    for name, unit in (("azimuth", along), ("elevation", up.reshape(-1, 3))):
        maps[f"boresight_{name}"] = np.einsum("nk,nk->n", tilt, unit).reshape(shape)
        error = np.linalg.norm(np.einsum("nak,nk->na", wrong, unit), axis=1)
        maps[f"boresight_{name}_error"] = error.reshape(shape)
    return maps


def _about_the_axis(tilt: np.ndarray, looks: np.ndarray) -> np.ndarray:
    """Rotate tilts found in the plane x = 0 on the side of +y about z to the plane of each look direction."""
    across = np.hypot(looks[:, 0], looks[:, 1])
    safe = np.where(across > 0.0, across, 1.0)
    sine, cosine = looks[:, 0] / safe, np.where(across > 0.0, looks[:, 1] / safe, 1.0)
    x, y = tilt[:, 0] * cosine + tilt[:, 1] * sine, -tilt[:, 0] * sine + tilt[:, 1] * cosine
    return np.stack([x, y, tilt[:, 2]], axis=1)


def _look(field: IndexField, pupil: Any, look: np.ndarray, options: dict[str, Any]) -> Look:
    """Return what full traces tell of one direction."""
    turned = replace(pupil, normal=look)
    axes, none = np.stack(turned.axes), np.zeros(len(NUMBERS))

    def numbers(*values: float) -> dict[str, float]:
        return dict(zip(("strehl", "strehl_standard_error", "opd_rms", "blocked", "known"), values, strict=True))

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the map shows undisturbed and unknown air
            prepared = PreparedStrehl(field, turned, allow_truncation=True, **options)
            air = prepared.job.air
            known = float(not (air.is_truncated or air.looks_past))
            found = prepared()
    except NoRayMeetsField:
        return Look(numbers(1.0, 0.0, 0.0, 0.0, 1.0), axes, np.zeros(2), False, none)
    except NoRayArrived:  # of a pupil in the body's shadow nothing is known
        return Look(numbers(np.nan, np.nan, np.nan, 1.0, 0.0), axes, np.full(2, np.nan), True, none + np.nan)
    own = numbers(found.value, found.standard_error, found.opd_rms, found.blocked, known)
    errors = found.budgets
    return Look(own, axes, found.boresight, True, errors.sampling, lambda: errors.model)


def _dataset(maps: list[dict[str, np.ndarray]], angles: list[np.ndarray], times, pupil, wavelength, ends: str):
    import xarray

    dims: tuple[str, ...] = ("azimuth", "elevation")
    coordinates: dict[str, Any] = {
        "azimuth": ("azimuth", angles[0], {"units": "rad", "long_name": "look angle toward x"}),
        "elevation": ("elevation", angles[1], {"units": "rad", "long_name": "look angle toward y"}),
    }
    if times is not None:
        dims = ("time", *dims)
        coordinates["time"] = ("time", np.asarray(times), {"units": "s", "long_name": "time"})
    variables = {}
    for name, (units, words) in VARIABLES.items():
        values = np.stack([one[name] for one in maps]) if times is not None else maps[0][name]
        variables[name] = (dims, values, {"units": units, "long_name": words})
    about = {
        "title": "optics over look angles",
        "source": f"aerokernels {__version__}",
        "pupil": f"{type(pupil).__name__} at {pupil.center.tolist()} m",
        "wavelength": wavelength,
        "ends": ends,
    }
    return xarray.Dataset(variables, coordinates, about)


def tell_errors(found: list[Look], looks: np.ndarray) -> np.ndarray:
    """Add "strehl_error" and "opd_rms_error" to directions' numbers; return errors of their tilts.

    Returns:
        Vectors in space along both of each pupil's axes, of the errors' lengths [rad], shape (n, 2, 3).
    """
    rows = np.array([k for k, one in enumerate(found) if one.model is not None], int)
    model = np.zeros((len(found), len(found[0].sampling)))
    axes = np.stack([one.axes for one in found])
    along = axes.copy()
    if len(rows):
        few, nearest = few_of(looks[rows], np.array([found[k].numbers["opd_rms"] for k in rows]))
        model[rows] = np.stack([found[k].model() for k in rows[few]])[nearest]
        along[rows] = axes[rows[few]][nearest]
    total = np.hypot(model, np.stack([one.sampling for one in found]))
    for one, error in zip(found, total, strict=True):  # in the order of NUMBERS
        one.numbers |= {"strehl_error": float(error[0]), "opd_rms_error": float(error[2])}
    # Another direction's axes, as they lie across this one.
    normal = np.cross(axes[:, 0], axes[:, 1])
    along -= np.einsum("nak,nk->na", along, normal)[..., None] * normal[:, None]
    return np.asarray(along * total[:, 3:5, None])


def few_of(looks: np.ndarray, rms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of a few directions, by unit vectors and OPD rms [m], and for each one which of them is nearest."""
    level = np.log10(np.maximum(rms, 1e-4 * rms.max(initial=0.0) + 1e-300))
    place = np.column_stack([looks, level])
    rows = [int(np.argmax(rms))]
    apart = [np.linalg.norm(place - place[rows[0]], axis=1)]
    while len(rows) < 8 and np.min(apart, axis=0).max() > 0.0:
        rows.append(int(np.argmax(np.min(apart, axis=0))))
        apart.append(np.linalg.norm(place - place[rows[-1]], axis=1))
    return np.array(rows), np.argmin(apart, axis=0)
