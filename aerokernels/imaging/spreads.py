"""Point spread functions of a camera through a flow, at nodes over its picture, by matrix Fourier transforms.

If the flow makes a ray land at L beside its point X, the path to X follows from the path to L:

    far scene      opd - n_0 (L - X) d / (d' d)            d, d' its direction without and with the flow
    near scene     opd - n_0 d' (L - X) + n_0 |L - X|^2 / 2 R     across d', R the distance from the pupil
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..medium import IndexField
from ..process.threads import in_threads, product_on_one_core
from ..rays import RayBundle
from ..tracing import Plane, trace
from ..tracing.stop import greatest_contrast, reached, way_beyond
from ..wavefronts.pixels import pupil_grid
from .camera import Camera, along

NODES_AT_ONCE = 16  # whose point spread functions are computed together; speed only


@dataclass(frozen=True, eq=False)
class SpreadGrid:
    """Point spread functions at nodes over a picture."""

    rows: np.ndarray  # rows of the nodes, shape (m,)
    columns: np.ndarray  # columns of the nodes, shape (n,)
    # Share of a pixel's light that comes from each of the scene's pixels around it, by node, shape (m, n, size, size),
    # axes [.., y, x]; each kernel sums to 1.
    kernel: np.ndarray
    # Shift of each node in whole pixels, along y and x, shape (m, n, 2): the middle of a kernel, its element size // 2,
    # is the scene's pixel at this offset from the node.
    offset: np.ndarray
    kept: np.ndarray  # share of the light within the size of the kernels, shape (m, n)


def nodes_along(count: int, node_count: int) -> np.ndarray:
    """Return the pixels of nodes along a side of the picture, from the first to the last, at most `node_count`."""
    if count == 1 or node_count == 1:
        return np.array([(count - 1) // 2])
    return np.unique(np.rint(np.linspace(0, count - 1, min(node_count, count))).astype(int))


def spread_grid(
    field: IndexField,
    camera: Camera,
    shape: tuple[int, int],
    shift: np.ndarray,
    *,
    node_count: int,
    size: int,
    pupil_pixels: int,
    options: dict[str, Any],
    spectrum: tuple[np.ndarray, np.ndarray],
) -> SpreadGrid:
    """Return point spread functions of a camera through a field, in light of some wavelengths with one OPD.

    `shift` is the scene position seen by each pixel minus the one without the flow, along x and y [pixels], `size` the
    side of the kernels [pixels], `spectrum` vacuum wavelengths [m] and weights that sum to 1.
    """
    rows, columns = nodes_along(shape[0], node_count), nodes_along(shape[1], node_count)
    pupil = PupilSamples(camera, pupil_pixels)
    x, y = camera.tangents(shape)
    column, row = (axis.ravel() for axis in np.meshgrid(columns, rows))
    tangent = np.stack([x[column], y[row]], axis=1)
    opd, arrived = node_paths(field, camera, tangent, pupil.points, options)
    moved = shift[row, column]
    moved = np.where(np.isfinite(moved), moved, 0.0)
    whole = np.rint(moved).astype(int)
    # The camera's angles are those of rays in the ambient medium, where a wavelength is shorter by its index.
    opd, lengths = opd / field.ambient_index, spectrum[0] / field.ambient_index
    tilt = _cosines(tangent + moved * camera.pixel_tangent) - _cosines(tangent)
    kernel, kept = np.zeros((len(row), size, size)), np.zeros(len(row))

    def spread(part: slice) -> None:
        flat, fraction = opd[part] - tilt[part] @ pupil.points.T, (moved - whole)[part]
        for length, weight in zip(lengths.tolist(), spectrum[1].tolist(), strict=True):
            one, share = pupil.spreads(flat, arrived[part], fraction, tangent[part], length, size)
            kernel[part] += weight * one
            kept[part] += weight * share

    in_threads(spread, [slice(first, first + NODES_AT_ONCE) for first in range(0, len(row), NODES_AT_ONCE)])
    place, offset = (len(rows), len(columns)), whole[:, ::-1]
    return SpreadGrid(rows, columns, kernel.reshape(*place, size, size), offset.reshape(*place, 2), kept.reshape(place))


class PupilSamples:
    """Rays across a camera's pupil, from `points` in the middles of square pixels [m], shape (lit count, 2)."""

    def __init__(self, camera: Camera, pupil_pixels: int):
        """Take the rays of a number of pixels across."""
        coordinate, self.step, self.weight, _ = pupil_grid(camera.pupil, pupil_pixels)
        up, across = np.nonzero(self.weight > 0.0)
        self.camera, self.points = camera, np.stack([coordinate[across], coordinate[up]], axis=1)

    def spreads(
        self, opd: np.ndarray, arrived: Any, fraction: np.ndarray, tangent: np.ndarray, length: float, size: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return `pixel_spreads` of paths [m], shape (nodes, lit count), at a wavelength in the ambient medium [m]."""
        lit = self.weight > 0.0
        wave = np.zeros((len(opd), *lit.shape), dtype=np.complex128)
        wave[:, lit] = self.weight[lit] * arrived * phasors(2.0 * np.pi / length * opd)
        return pixel_spreads(wave, self.step, fraction, tangent, self.camera, length, size)


def node_paths(
    field: IndexField, camera: Camera, tangent: np.ndarray, q: np.ndarray, options: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the OPD [m] at points q (n, 2) of the pupil [m] for light from the scene at tangents (m, 2), with defocus.

    Also 1 where it is known, else 0, both of shape (m, n).
    """
    pupil, distance = camera.pupil, camera.distance
    first, second = pupil.axes
    far = not np.isfinite(distance)
    defocus = defocus_paths(camera, tangent, q)
    start = pupil.center + q[:, :1] * first + q[:, 1:] * second
    if far:
        ways = camera.directions(*tangent.T)
        beyond = way_beyond(field.box, pupil.center, pupil.reach, ways, greatest_contrast(field))
        depth = float((beyond * along(ways, pupil.normal)).max())
    else:
        depth = distance
    toward = tangent[:, None, :] - (0.0 if far else q / distance) + np.zeros(q.shape)
    aim = camera.directions(*toward.reshape(-1, 2).T)
    position = np.broadcast_to(start, (*defocus.shape, 3)).reshape(-1, 3)
    plane = Plane(pupil.center + depth * pupil.normal, pupil.normal)
    rays = RayBundle.of_units(position, aim)
    traced = trace(field, rays, until=plane, outputs=("opd", "position", "direction"), **options)
    assert traced.opd is not None and traced.position is not None and traced.direction is not None  # requested
    index, arrived = field.ambient_index, reached(traced.traced_status)
    length = depth / along(aim, pupil.normal)
    beside = traced.position - (position + length[:, None] * aim)
    if far:
        beyond = -_dot(beside, aim) / _dot(traced.direction, aim)
    else:
        ahead = _dot(beside, traced.direction)
        beyond = -ahead + 0.5 * (_dot(beside, beside) - ahead**2) / length
    paths = np.where(arrived, traced.opd + index * beyond, 0.0).reshape(defocus.shape) + index * defocus
    return paths, arrived.astype(np.float64).reshape(defocus.shape)


def _dot(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return scalar products of vectors (.., 3)."""
    return np.asarray(np.einsum("...i,...i->...", left, right))


def defocus_paths(camera: Camera, tangent: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the OPD [m] at points q (n, 2) of the pupil for light from the scene at tangents (m, 2), with defocus."""
    if camera.distance == camera.focus_distance:
        return np.zeros((len(tangent), len(q)))
    ways = []
    for distance in (camera.distance, camera.focus_distance):
        if not np.isfinite(distance):
            ways.append(-_cosines(tangent) @ q.T)
            continue
        size = distance * np.sqrt(1.0 + np.sum(tangent**2, axis=1))[:, None]
        # |X - q| - |X|, avoiding a difference of nearly equal numbers
        change = np.sum(q**2, axis=1) - 2.0 * distance * (tangent @ q.T)
        ways.append(change / (np.sqrt(size**2 + change) + size))
    return np.asarray(ways[0] - ways[1])


def _cosines(tangent: np.ndarray) -> np.ndarray:
    """Return direction cosines across the axis of tangents (.., 2)."""
    return np.asarray(tangent / np.sqrt(1.0 + np.sum(tangent**2, axis=-1, keepdims=True)))


def phasors(phase: np.ndarray) -> np.ndarray:
    """Return exp(i phase) of phases [rad], of the same shape."""
    found = np.empty(phase.shape, dtype=np.complex128)
    np.cos(phase, out=found.real)
    np.sin(phase, out=found.imag)
    return found


def pixel_spreads(
    wave: np.ndarray,
    step: float,
    fraction: np.ndarray,
    tangent: np.ndarray,
    camera: Camera,
    wavelength: float,
    size: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the light from scene pixels around nodes, shape (n, size, size), each sums to 1; share of all light (n,).

    `wave` holds complex amplitudes over the pupil's pixels of side `step` [m], shape (n, y, x); `fraction` the centres
    of the point spread functions along x and y [pixels], `tangent` the tangents of the nodes, both (n, 2).
    """
    power = np.sum(wave.real**2 + wave.imag**2, axis=(1, 2))
    square = 1.0 + np.sum(tangent**2, axis=1, keepdims=True)
    # Direction cosines per pixel, along x and y.
    scale = (1.0 - tangent**2 / square) / np.sqrt(square) * camera.pixel_tangent
    # The transform is periodic: a kernel wider than the period would count light twice.
    side = np.clip((wavelength / step / scale.max(axis=1)).astype(int), 1, size)
    kernel, share = np.zeros((len(wave), size, size)), np.ones(len(wave))
    dark = power == 0.0
    kernel[dark, size // 2, size // 2] = 1.0
    for one_side in np.unique(side[~dark]):
        some = np.flatnonzero((side == one_side) & ~dark)
        found = _through_pixels(wave[some], fraction[some], scale[some] * (step / wavelength), int(one_side))
        total = found.sum(axis=(1, 2))
        share[some] = total * np.prod(scale[some], axis=1) / ((wavelength / step) ** 2 * power[some])
        begin = size // 2 - one_side // 2
        kernel[some, begin : begin + one_side, begin : begin + one_side] = found / total[:, None, None]
    return kernel, np.minimum(share, 1.0)


def _through_pixels(wave: np.ndarray, fraction: np.ndarray, scale: np.ndarray, side: int) -> np.ndarray:
    r"""Return the light between square pixels around each node, shape (n, side, side), exact axis by axis.

        \int |A(p)|^2 tri(p - j) dp = sum_d C(d) sinc(scale d)^2 exp(-2 pi i scale d (j - fraction))

    C is the wave's autocorrelation, tri the overlap of a scene pixel and a camera pixel, `scale` in waves per pixel of
    the pupil and pixel of the picture, along x and y, shape (n, 2).
    """
    from scipy.fft import fft2, next_fast_len, rfft2

    count = wave.shape[-1]
    length = next_fast_len(2 * count - 1)
    transform = fft2(wave, (length, length))
    # Of the conjugate; one half only, the other half being conjugate to it.
    correlation = rfft2(transform.real**2 + transform.imag**2)[..., :count] / length**2
    place, apart = np.arange(side) - side // 2, np.arange(count)
    along = []
    for axis in (1, 0):
        turn = 2.0 * np.pi * scale[:, axis, None] * apart
        factor = phasors(turn[:, None] * place[:, None]) * phasors(-turn * fraction[:, axis, None])[:, None]
        along.append(factor * (np.sinc(scale[:, axis, None] * apart) ** 2)[:, None])
    rows, columns = along
    both = np.zeros((len(wave), side, length), dtype=np.complex128)
    both[..., :count], both[..., length - count + 1 :] = rows, rows[..., :0:-1].conj()
    columns[..., 1:] *= 2.0
    light = product_on_one_core(product_on_one_core(both, correlation), columns.transpose(0, 2, 1)).real
    return np.maximum(light, 0.0)  # rounding in dark pixels
