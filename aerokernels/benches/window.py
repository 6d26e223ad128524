"""Window of a bench: direction of the light, axes and pixels of the picture, start and end of the rays."""

from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..pupils.base import as_unit_vector

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class Window:
    """Viewing direction, pixels and extent of a picture of a field."""

    forward: np.ndarray  # direction of the light, shape (3,)
    right: np.ndarray  # direction of the picture's horizontal axis, shape (3,)
    up: np.ndarray  # direction of its vertical axis, shape (3,)
    horizontal: np.ndarray  # pixel centres along `right` [m], shape (nx,)
    vertical: np.ndarray  # pixel centres along `up` [m], shape (ny,)
    pitch: tuple[float, float]  # width and height of a pixel [m]
    entry: float  # coordinate along `forward` at which rays start [m]
    exit: float  # coordinate along `forward` at which they have left the field [m]

    @property
    def middle(self) -> float:
        """Coordinate along `forward` of the field's middle [m]."""
        return 0.5 * (self.entry + self.exit)


def make_window(field: IndexField, view, extent, pixel_count, width: float | None) -> Window:
    """Make the window of a field; for the arguments see `line_of_sight`."""
    forward, right, up = _view_axes(view)
    low, high = _finite_box(field, forward, width)
    horizontal, vertical, pitch = _pixels(low, high, right, up, extent, pixel_count)
    entry, exit_ = _span(low, high, forward)
    if field.geometry != "planar":  # rounding would decide whether rays meet a plane on a face of the box
        entry, exit_ = entry - 0.005 * (exit_ - entry), exit_ + 0.005 * (exit_ - entry)
    return Window(forward, right, up, horizontal, vertical, pitch, entry, exit_)


def ray_lines(window: Window, rays_per_pixel: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of k rays per pixel along right, shape (nx k,), and along up, shape (ny k,) [m]."""
    offset = (np.arange(rays_per_pixel) - 0.5 * (rays_per_pixel - 1)) / rays_per_pixel
    right, up = (
        (centres[:, None] + pitch * offset).ravel()
        for centres, pitch in zip((window.horizontal, window.vertical), window.pitch, strict=True)
    )
    return right, up


def _view_axes(view) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return forward, right and up as seen along the light with y up (x up for light along y)."""
    if isinstance(view, str) and view not in _AXES:
        raise ValueError(f"view {view!r} is not known: choose 'x', 'y', 'z' or three numbers")
    forward = as_unit_vector(_AXES[view] if isinstance(view, str) else view, "view")
    upright = np.array(_AXES["y"] if abs(forward[1]) < 0.99 else _AXES["x"])
    right = np.cross(forward, upright)
    right /= np.linalg.norm(right)
    return forward, right, np.cross(right, forward)


def _finite_box(field: IndexField, forward: np.ndarray, width: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the field's box; a planar field is cut to `width` along x, and light must be along x."""
    low, high = field.box
    if field.geometry != "planar":
        if width is not None:
            raise ValueError(f"width = {width}: {field.geometry} fields have their own; leave it out")
        return low, high
    if width is None or not (np.isfinite(width) and width > 0.0):
        raise ValueError(f"width = {width}: a planar field is infinite in x; give the length of the light's path [m]")
    if abs(forward[0]) < 1.0 - 1e-12:
        raise ValueError(
            f"view {forward.tolist()}: look through a planar field along x, the axis along which it is constant"
        )
    return np.array([-0.5 * width, *low[1:]]), np.array([0.5 * width, *high[1:]])


def _span(low: np.ndarray, high: np.ndarray, axis: np.ndarray) -> tuple[float, float]:
    """Return the least and greatest coordinate of a box along `axis` [m]."""
    ends = np.stack([low * axis, high * axis])
    return float(ends.min(axis=0).sum()), float(ends.max(axis=0).sum())


def _pixels(low, high, right, up, extent, pixel_count) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Return pixel centres along right and up [m], and the size of a pixel."""
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
    spans = np.array([np.ptp(_span(low, high, axis)) for axis in (right, up)])
    if (size > counts * spans).any():
        raise ValueError(
            f"extent {extent!r} has pixels of {size[0] / counts[0]:.3g} by {size[1] / counts[1]:.3g} m, the field "
            f"is {spans[0]:.3g} by {spans[1]:.3g} m: give metres, or more pixels"
        )
    step = size / counts
    horizontal, vertical = (extent[2 * k] + (np.arange(counts[k]) + 0.5) * step[k] for k in range(2))
    return horizontal, vertical, (float(step[0]), float(step[1]))
