"""Point spread functions of a camera through a flow, at nodes over its picture.

At a node the rays of a grid of the pupil's points go to the point of the scene that the node's pixel looks at. Their
OPD, less the tilt that the displacement stands for, makes the point spread function by a matrix Fourier transform. It
is integrated over pixels of the scene and of the camera: squares of even brightness seen by square pixels. Of a ray
that a flow lands beside its point X, the path to X follows from that to its landing L:

    far scene      opd - n_0 (L - X) d / (d' d)            d, d' its direction without and with the flow
    near scene     opd - n_0 d' (L - X) + n_0 |L - X|^2 / 2 R     across d', R the distance from the pupil
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing import Plane, trace
from ..tracing.lines import box_size
from ..wavefront.traced import pupil_grid
from .camera import Camera

# Samples of the point spread function to a pixel, at most.
MOST_PARTS = 16


@dataclass(frozen=True, eq=False)
class SpreadGrid:
    """Point spread functions at nodes over a picture.

    Attributes:
        rows: Rows of the nodes, shape (m,).
        columns: Columns of the nodes, shape (n,).
        kernel: Share of the light of a pixel that comes from the scene's pixels around, by node, shape
            (m, n, size, size), axes [.., y, x]; each sums to 1.
        offset: The shift of each node in whole pixels, along y and x, shape (m, n, 2): the middle of a kernel, its
            element size // 2, belongs to the scene's pixel that far from the node.
        kept: Share of the light that the kernels' size holds, shape (m, n).
    """

    rows: np.ndarray
    columns: np.ndarray
    kernel: np.ndarray
    offset: np.ndarray
    kept: np.ndarray


def nodes_along(count: int, node_count: int) -> np.ndarray:
    """Pixels of nodes along a side of the picture, from the first to the last, shape (at most node_count,)."""
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
    wavelengths: np.ndarray | None = None,
) -> tuple[SpreadGrid, ...]:
    """Point spread functions of a camera through a field, at each of some wavelengths of one OPD.

    Args:
        field: The refractive index.
        camera: The camera.
        shape: Rows and columns of the picture.
        shift: What a pixel sees less what it would see without the flow, along x and y [pixels], shape (*shape, 2).
        node_count: Nodes along a side of the picture.
        size: Side of the kernels [pixels].
        pupil_pixels: Rays across the pupil.
        options: Options of `trace`.
        wavelengths: Vacuum wavelengths [m], shape (n,); None: the one that is traced for.
    """
    rows, columns = nodes_along(shape[0], node_count), nodes_along(shape[1], node_count)
    coordinate, step, weight, _ = pupil_grid(camera.pupil, pupil_pixels)
    x, y = camera.tangents(shape)
    column, row = (axis.ravel() for axis in np.meshgrid(columns, rows))
    tangent = np.stack([x[column], y[row]], axis=1)
    lit = weight > 0.0
    q = np.stack([axis[lit] for axis in np.meshgrid(coordinate, coordinate)], axis=1)
    opd, arrived, wavelength = node_paths(field, camera, tangent, q, options)
    moved = shift[row, column]
    moved = np.where(np.isfinite(moved), moved, 0.0)
    whole = np.rint(moved).astype(int)
    lengths = [wavelength] if wavelengths is None else [float(one) for one in wavelengths]
    kernels = np.zeros((len(lengths), len(row), size, size))
    kept = np.zeros((len(lengths), len(row)))
    for node in range(len(row)):
        t = tangent[node]
        tilt = _cosines(t + moved[node] * camera.pixel_tangent) - _cosines(t)
        flat = opd[node] - q @ tilt
        for number, length in enumerate(lengths):
            wave = np.zeros(weight.shape, dtype=np.complex128)
            wave[lit] = weight[lit] * arrived[node] * np.exp(2j * np.pi / length * flat)
            kernels[number, node], kept[number, node] = pixel_spread(
                wave, coordinate, step, moved[node] - whole[node], t, camera, length, size
            )
    place = (len(rows), len(columns))
    offset = whole[:, ::-1].reshape(*place, 2)
    return tuple(
        SpreadGrid(rows, columns, kernel.reshape(*place, size, size), offset, share.reshape(place))
        for kernel, share in zip(kernels, kept, strict=True)
    )


def mixed(grids: tuple[SpreadGrid, ...], weights: np.ndarray) -> SpreadGrid:
    """The point spread functions of light of several wavelengths, with weights (n,) that sum to 1."""
    kernel = np.tensordot(weights, np.stack([grid.kernel for grid in grids]), 1)
    kept = np.tensordot(weights, np.stack([grid.kept for grid in grids]), 1)
    return replace(grids[0], kernel=kernel, kept=kept)


def node_paths(
    field: IndexField | None, camera: Camera, tangent: np.ndarray, q: np.ndarray, options: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, float]:
    """OPD [m] of points q (n, 2) of the pupil [m] for light of the scene at tangents (m, 2), defocus included.

    Returns:
        OPD and whether it is known, both of shape (m, n); the wavelength [m].
    """
    pupil, distance = camera.pupil, camera.distance
    first, second = pupil.axes
    far = not np.isfinite(distance)
    defocus = _defocus(camera, tangent, q)
    if field is None:
        return defocus, np.ones(defocus.shape), float(options["wavelength"])
    axial = camera.directions(*tangent.T)
    start = pupil.center + q[:, :1] * first + q[:, 1:] * second
    if far:
        aim = np.repeat(axial, len(q), axis=0)
        low, high = field.box
        corner = np.where(pupil.normal > 0.0, high, low)
        reach = float((np.where(np.isfinite(corner), corner, pupil.center) - pupil.center) @ pupil.normal)
        depth = max(reach, 0.0) + 1e-3 * box_size(field) + 1e-6
    else:
        u = distance * (tangent[:, None, :] - 0.0) - q
        aim = camera.directions(*(u / distance).reshape(-1, 2).T)
        depth = distance
    position = np.tile(start, (len(tangent), 1))
    plane = Plane(pupil.center + depth * pupil.normal, pupil.normal)
    outputs = ("opd", "position", "direction")
    traced = trace(field, RayBundle(position, aim), until=plane, outputs=outputs, **options)
    assert traced.opd is not None and traced.position is not None and traced.direction is not None  # asked for
    arrived = traced.ok
    undisturbed = position + (depth / (aim @ pupil.normal))[:, None] * aim
    beside = traced.position - undisturbed
    index = field.ambient_index
    if far:
        beyond = -np.sum(beside * aim, axis=1) / np.sum(traced.direction * aim, axis=1)
        opd = traced.opd + index * beyond
    else:
        along = np.sum(beside * traced.direction, axis=1)
        across = np.sum(beside**2, axis=1) - along**2
        opd = traced.opd + index * (-along + 0.5 * across / (depth / (aim @ pupil.normal)))
    opd = np.where(arrived, opd, 0.0).reshape(defocus.shape) + index * defocus
    return opd, arrived.reshape(defocus.shape).astype(np.float64), traced.wavelength


def _defocus(camera: Camera, tangent: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Path from the scene less path from the plane in focus, both less that to the middle [m], shape (m, n)."""
    if camera.distance == camera.focus_distance:
        return np.zeros((len(tangent), len(q)))
    ways = []
    for distance in (camera.distance, camera.focus_distance):
        if not np.isfinite(distance):
            ways.append(-_cosines(tangent) @ q.T)
            continue
        size = distance * np.sqrt(1.0 + np.sum(tangent**2, axis=1))[:, None]
        # |X - q| - |X| without a difference of nearly equal numbers
        change = np.sum(q**2, axis=1) - 2.0 * distance * (tangent @ q.T)
        ways.append(change / (np.sqrt(size**2 + change) + size))
    return np.asarray(ways[0] - ways[1])


def _cosines(tangent: np.ndarray) -> np.ndarray:
    """Direction cosines across the axis of tangents (.., 2)."""
    return np.asarray(tangent / np.sqrt(1.0 + np.sum(tangent**2, axis=-1, keepdims=True)))


def pixel_spread(
    wave: np.ndarray,
    coordinate: np.ndarray,
    step: float,
    fraction: np.ndarray,
    tangent: np.ndarray,
    camera: Camera,
    wavelength: float,
    size: int,
) -> tuple[np.ndarray, float]:
    """The light from pixels of the scene about a node, shape (size, size), which sums to 1, and the share it is.

    Args:
        wave: Complex amplitude over the pupil's pixels, axes [y, x]; where it is dark all light stays in its pixel.
        coordinate: Their places [m].
        step: Their side [m].
        fraction: Where the point spread function is centred, along x and y [pixels].
        tangent: Tangents of the node.
        camera: The camera.
        wavelength: Vacuum wavelength [m].
        size: Side of the kernel [pixels].
    """
    power = float(np.sum(np.abs(wave) ** 2))
    kernel = np.zeros((size, size))
    if power == 0.0:
        kernel[size // 2, size // 2] = 1.0
        return kernel, 1.0
    square = 1.0 + tangent @ tangent
    # Of direction cosines per tangent, along x and y.
    scale = (1.0 - tangent**2 / square) / np.sqrt(square) * camera.pixel_tangent
    width = len(coordinate) * step
    parts = int(np.clip(np.ceil(2.0 * float(scale.max()) * width / wavelength), 1, MOST_PARTS))
    # The transform repeats itself: a kernel as wide as that would hold light twice.
    held = min(size, max(1, int(wavelength / step / float(scale.max()))))
    pixels = np.arange(held) - held // 2
    # A pixel of the scene and one of the camera share a triangle of the distance between them.
    place = pixels[0] - 1.0 + (np.arange((held + 1) * parts) + 0.5) / parts
    overlap = np.clip(1.0 - np.abs(pixels[:, None] - place), 0.0, None)
    transform = [
        np.exp(-2j * np.pi / wavelength * np.outer(scale[axis] * (place - fraction[axis]), coordinate))
        for axis in (1, 0)
    ]
    light = np.abs(transform[0] @ wave @ transform[1].T) ** 2
    found = overlap @ light @ overlap.T
    share = found.sum() * float(np.prod(scale)) / parts**2 / ((wavelength / step) ** 2 * power)
    begin = size // 2 - held // 2
    kernel[begin : begin + held, begin : begin + held] = found / found.sum()
    return kernel, float(min(share, 1.0))
