"""Synthetic schlieren: what a bench with a knife edge would show of a field.

Parallel light crosses the field and is bent by the angle e = (e_right, e_up) = integral of grad_perp(n) / n_0 ds. The
bench images the source, of height h, onto a knife edge with a lens of focal length f; the edge cuts off the fraction
`cut_off` of it. A ray bent by e moves its source image by f e, and the edge lets more or less of it through:

    I / I_open = (1 - cut_off) + (f / h) e_cut,    cut to 0 .. 1

e_cut is the component across the edge: a "vertical" edge sees e_right, a "horizontal" one e_up. f / h is the
`sensitivity` [1/rad]. Rays are traced with their bending; the picture is focused on where they enter.

Reference: G. S. Settles, Schlieren and Shadowgraph Techniques (Springer, 2001), sections 2.3 and 3.2.
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle, as_unit_vector
from aerokernels.tracing import Plane, RayStatus, trace

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_COMPONENT = {"vertical": 0, "horizontal": 1}


@dataclass(frozen=True, eq=False)
class SchlierenImage:
    """A schlieren picture, rows from the lowest up, and what it was made of.

    Attributes:
        intensity: light that passes the edge, 1 for all of it, 0 behind the body; shape (ny, nx).
        horizontal: pixel centres along `right` [m], shape (nx,); z where the view is along x.
        vertical: pixel centres along `up` [m], shape (ny,); y where the view is along x.
        deflection: angles toward right and up [rad], shape (ny, nx, 2); NaN where no ray came through.
        opd: optical path difference against the ambient medium [m], shape (ny, nx); NaN where no ray came through.
        blocked: pixels that the body hides, shape (ny, nx).
        right: direction of the picture's horizontal axis, shape (3,).
        up: direction of its vertical axis, shape (3,).
        knife_edge: "vertical" or "horizontal".
        cut_off: fraction of the undisturbed source image that the edge holds back.
        sensitivity: change of intensity per deflection [1/rad].
    """

    intensity: np.ndarray
    horizontal: np.ndarray
    vertical: np.ndarray
    deflection: np.ndarray
    opd: np.ndarray
    blocked: np.ndarray
    right: np.ndarray
    up: np.ndarray
    knife_edge: str
    cut_off: float
    sensitivity: float


def schlieren(
    field: IndexField,
    *,
    view="x",
    extent: tuple[float, float, float, float] | None = None,
    pixel_count: int | tuple[int, int] = 256,
    width: float | None = None,
    knife_edge: str = "vertical",
    cut_off: float = 0.5,
    sensitivity: float | None = None,
    tolerance: float = 1e-3,
    wavelength: float = 905e-9,
    backend: str = "auto",
    device: str | None = None,
    precision: str = "float32",
) -> SchlierenImage:
    """Make a schlieren picture of a field.

    Args:
        field: any field; a planar one needs `width` and a view along x.
        view: direction of the light, "x", "y", "z" or three numbers.
        extent: right from, to, up from, to [m]; None takes in the field's box.
        pixel_count: pixels along right and up, or along the longer side of square pixels.
        width: length of the light's way through a planar field [m].
        knife_edge: "vertical" shows changes along the picture's horizontal, "horizontal" those along its vertical.
        cut_off: fraction of the undisturbed source image that the edge holds back, 0 to 1.
        sensitivity: f / h [1/rad]; None lets the largest 0.5 % of the deflections saturate.
        tolerance: OPD error asked of the tracer [waves].
        wavelength: vacuum wavelength [m].
        backend: as in `trace`.
        device: as in `trace`.
        precision: as in `trace`.

    Raises:
        ValueError: an argument that makes no sense; the message names it and the remedy.
    """
    if knife_edge not in _COMPONENT:
        raise ValueError(f"knife_edge {knife_edge!r} is not known: choose 'vertical' or 'horizontal'")
    if not 0.0 <= cut_off <= 1.0:
        raise ValueError(f"cut_off = {cut_off}: give a fraction from 0 to 1")
    if sensitivity is not None and not np.isfinite(sensitivity):
        raise ValueError(f"sensitivity = {sensitivity}: give a finite number per radian, or None")
    forward, right, up = _view_axes(view)
    low, high = _finite_box(field, forward, width)
    horizontal, vertical = _pixel_centres(low, high, right, up, extent, pixel_count)

    entry, exit_ = _span(low, high, forward)
    if field.geometry != "planar":  # a plane on a face of the box would be met or missed by a rounding
        entry, exit_ = entry - 0.005 * (exit_ - entry), exit_ + 0.005 * (exit_ - entry)
    across, along = np.meshgrid(horizontal, vertical)
    start = across[..., None] * right + along[..., None] * up + entry * forward
    rays = RayBundle(start.reshape(-1, 3), np.broadcast_to(forward, (start.size // 3, 3)))
    traced = trace(
        field,
        rays,
        until=Plane(exit_ * forward, forward),
        tolerance=tolerance,
        wavelength=wavelength,
        backend=backend,
        device=device,
        precision=precision,
        outputs=("direction", "opd"),
    )
    assert traced.direction is not None and traced.opd is not None  # asked for above
    shape = across.shape
    through = traced.ok.reshape(shape)
    direction = traced.direction.reshape(*shape, 3)
    deflection = np.where(through[..., None], np.stack([direction @ right, direction @ up], axis=-1), np.nan)
    opd = np.where(through, traced.opd.reshape(shape), np.nan)
    blocked = (traced.status == RayStatus.HIT_BODY).reshape(shape)

    cut = deflection[..., _COMPONENT[knife_edge]]
    if sensitivity is None:
        sensitivity = _full_range_sensitivity(cut[through], cut_off)
    intensity = np.where(through, np.clip(1.0 - cut_off + sensitivity * cut, 0.0, 1.0), 0.0)
    return SchlierenImage(
        intensity,
        horizontal,
        vertical,
        deflection,
        opd,
        blocked,
        right,
        up,
        knife_edge,
        float(cut_off),
        float(sensitivity),
    )


def _view_axes(view) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forward, right and up as seen along the light with y up (x up for light along y)."""
    if isinstance(view, str) and view not in _AXES:
        raise ValueError(f"view {view!r} is not known: choose 'x', 'y', 'z' or three numbers")
    forward = as_unit_vector(_AXES[view] if isinstance(view, str) else view, "view")
    upright = np.array(_AXES["y"] if abs(forward[1]) < 0.99 else _AXES["x"])
    right = np.cross(forward, upright)
    right /= np.linalg.norm(right)
    return forward, right, np.cross(right, forward)


def _finite_box(field: IndexField, forward: np.ndarray, width: float | None) -> tuple[np.ndarray, np.ndarray]:
    """The field's box; a planar one is cut to `width`, which only light along x crosses in full."""
    low, high = field.box
    if field.geometry != "planar":
        if width is not None:
            raise ValueError(f"width = {width}: a {field.geometry} field has its own; leave it out")
        return low, high
    if width is None or not (np.isfinite(width) and width > 0.0):
        raise ValueError(f"width = {width}: a planar field has no end in x; give the length of the light's way [m]")
    if abs(forward[0]) < 1.0 - 1e-12:
        raise ValueError(
            f"view {forward.tolist()}: look through a planar field along x, which it does not change along"
        )
    return np.array([-0.5 * width, *low[1:]]), np.array([0.5 * width, *high[1:]])


def _span(low: np.ndarray, high: np.ndarray, axis: np.ndarray) -> tuple[float, float]:
    """Least and greatest coordinate of a box along `axis` [m]."""
    ends = np.stack([low * axis, high * axis])
    return float(ends.min(axis=0).sum()), float(ends.max(axis=0).sum())


def _pixel_centres(low, high, right, up, extent, pixel_count) -> tuple[np.ndarray, np.ndarray]:
    if extent is None:
        extent = (*_span(low, high, right), *_span(low, high, up))
    if len(extent) != 4 or not np.isfinite(extent).all() or extent[0] >= extent[1] or extent[2] >= extent[3]:
        raise ValueError(f"extent {extent!r}: give (right from, right to, up from, up to) in metres, increasing")
    size = np.array([extent[1] - extent[0], extent[3] - extent[2]])
    counts = np.asarray(pixel_count)
    if counts.dtype.kind not in "iu" or counts.shape not in ((), (2,)) or (counts < 1).any():
        raise ValueError(f"pixel_count {pixel_count!r}: give one whole number of at least 1, or two")
    if counts.shape == ():
        counts = np.maximum(1, np.rint(counts * size / size.max())).astype(int)
    step = size / counts
    return tuple(extent[2 * k] + (np.arange(counts[k]) + 0.5) * step[k] for k in range(2))


def _full_range_sensitivity(cut: np.ndarray, cut_off: float) -> float:
    """The sensitivity at which the edge's range is used by all but the largest deflections; 0 where there are none."""
    largest = float(np.quantile(np.abs(cut), 0.995)) if cut.size else 0.0
    room = min(cut_off, 1.0 - cut_off) or 1.0
    return room / largest if largest > 0.0 else 0.0
