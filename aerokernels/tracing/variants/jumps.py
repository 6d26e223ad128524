"""What the place of jumps between nodes, which no order of interpolation shows, may change.

A sum over nodes h apart sees what the field has at the wave number 2 pi / h; thinned by j it sees 2 pi / (j h). How
the changes by two, three and four decay tells what is left in the sum over all nodes. A step does not decay:
thinned by two it is half a cell off to either side, and 1 / sqrt(3) of that is the rms of a place drawn in its cell.
"""

from dataclasses import replace

import numpy as np

from ...medium import IndexField
from ...medium.mesh_samples import MeshSamples, mesh_columns
from .orders import in_space
from .paths import Cause, Contrast, Paths, Rays

# Draws of the jumps' place.
DRAWS = 8
# Widths of shocks [cells] whose decays are compared.
WIDTHS = np.linspace(1e-3, 8.0, 4000)
# Rays about a ray from which its size is taken, and its decay; rays and steps in distance by which likeness is found.
NEAR, NEAR_DECAY, COMPARED, BINS = 12, 64, 512, 25


def left_over(size: dict[int, np.ndarray]) -> np.ndarray:
    """The change of sums over all nodes over that of sums thinned by two, from rms changes by 2, 3 and 4 over a step's.

    It rises to 1 where the three are not of one shock: kinks, or several structures.
    """

    def decay(thin: int) -> np.ndarray:
        q = np.pi**2 * WIDTHS / thin
        return np.asarray(q / np.sinh(q))

    two, three, four = (np.maximum(size[thin], 1e-300) for thin in (2, 3, 4))

    def at(thin: int, wanted: np.ndarray) -> np.ndarray:
        ratio = np.minimum(1.0, two / (three if thin == 3 else four))
        return np.interp(-ratio, -decay(2) / decay(thin), wanted)

    off = np.abs(np.log(three / four / at(4, decay(3) / decay(4))))
    share = np.maximum(at(3, decay(1) / decay(2)), at(4, decay(1) / decay(2)))
    # Disagreement of two decays, as a logarithm, with those of a shock tanh(x / w), from which they count less; at
    # twice of it they do not count.
    return np.asarray(np.minimum(1.0, np.sqrt(3.0) * share) ** np.clip(2.0 - off / 0.25, 0.0, 1.0))


def jumps(field: IndexField, paths: Paths, thinned: tuple[tuple[Rays, dict[int, np.ndarray]], ...]) -> Cause:
    """Return the change by the place of jumps, and draws of it, from the results of `thinned_sums`."""
    from scipy.spatial import cKDTree

    place = _across(paths)
    _, near = cKDTree(place).query(place, min(NEAR_DECAY, len(place)))
    near = near.reshape(len(place), -1)

    def about(values: np.ndarray, count: int = NEAR_DECAY) -> np.ndarray:
        return np.asarray(np.sqrt(np.square(values)[near[:, :count]].mean(axis=1)))

    sums = Rays.still(len(place))
    for change, size in thinned:
        sums = sums + change * (left_over({thin: about(one) for thin, one in size.items()}) / np.sqrt(3.0))
    if not np.any(sums.opd):
        return Cause()
    return Cause(like=(sums,), draws=patterns(field, paths, about(sums.opd, NEAR), _alike(sums.opd, place)))


def patterns(field: IndexField, paths: Paths, size: np.ndarray, alike: float) -> tuple[Rays, ...]:
    """Draws of an optical path: sizes at rays [m] times patterns of rms 1, two to eight `alike` [m] long.

    Wavelengths are those of the steps that a jump makes across rows of nodes, but four cells to two widths of the
    bundle.
    """
    rng = np.random.default_rng(0)
    middle = paths.at(np.array([0.5]))[:, 0]
    axes, place = _axes(paths), _across(paths)
    reach, cell = float(np.linalg.norm(place - place.mean(axis=0), axis=1).max()), float(np.min(field.spacing))
    alike = min(alike, reach)
    low, high = 4.0 * cell, max(4.0 * reach, 4.0 * cell)
    waves = np.clip(2.0 * alike * 4.0 ** ((np.arange(DRAWS) + rng.random(DRAWS)) / DRAWS), low, high)
    only = _only_coordinate(field, middle, paths)
    left = (paths.rest + 0.5 * paths.length)[:, None]
    found = []
    for length, turn, start in zip(waves, *rng.uniform(0.0, 2.0 * np.pi, (2, DRAWS)), strict=True):
        wave = 2.0 * np.pi / length * (np.array([np.cos(turn), np.sin(turn)]) @ axes)
        phase = middle @ wave + start
        if only is not None:
            value, across = only
            phase, wave = 2.0 * np.pi / length * value + start, 2.0 * np.pi / length * across
        turned = -np.sqrt(2.0) * (size * np.sin(phase))[:, None] * wave / paths.index
        found.append(paths.landed(np.sqrt(2.0) * size * np.cos(phase), turned, turned * left))
    return tuple(found)


def _axes(paths: Paths) -> np.ndarray:
    """Return two axes across the bundle, unit vectors of shape (2, 3)."""
    mean = paths.ahead.mean(axis=0)
    return np.asarray(np.linalg.svd((mean / max(np.linalg.norm(mean), 1e-300))[None])[2][1:])


def _across(paths: Paths) -> np.ndarray:
    """Return the places of the paths' middles across the bundle [m], shape (n, 2)."""
    return np.asarray(paths.at(np.array([0.5]))[:, 0] @ _axes(paths).T)


def _only_coordinate(field: IndexField, middle: np.ndarray, paths: Paths) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the one coordinate on which a pattern depends (n,) and its gradient, where the field has only that."""
    if field.geometry == "planar":
        across = np.cross(paths.ahead, [1.0, 0.0, 0.0])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
        return np.sum(middle * across, axis=1), across
    if field.geometry == "axisymmetric" and np.all(np.abs(paths.ahead[:, 2]) > np.sqrt(0.5)):
        radius = np.hypot(middle[:, 0], middle[:, 1])
        outward = np.pad(middle[:, :2] / np.maximum(radius, 1e-300)[:, None], ((0, 0), (0, 1)))
        return radius, outward
    return None


def _alike(value: np.ndarray, place: np.ndarray) -> float:
    """Return the distance [m] at which a pattern has lost half of its correlation, about zero; inf: nowhere."""
    rows = slice(None, None, max(1, len(place) // COMPARED))
    value, place = value[rows], place[rows]
    apart = np.linalg.norm(place[:, None] - place, axis=2)
    edges = np.linspace(0.0, apart.max() / 2.0, BINS)
    which = np.digitize(apart.ravel(), edges)
    product = np.bincount(which, np.outer(value, value).ravel(), BINS + 2) / np.maximum(
        np.bincount(which, minlength=BINS + 2), 1
    )
    lost = np.flatnonzero(product[1:BINS] < 0.5 * np.mean(value**2))
    return float(edges[lost[0] + 1]) if len(lost) else np.inf


def next_order(field: IndexField) -> Contrast:
    """Return the change of the contrast by the next order of a mesh's interpolant."""
    samples = field.samples
    assert isinstance(samples, MeshSamples)
    bilinear = samples if samples.interpolation == "bilinear" else replace(samples, interpolation="bilinear")

    def contrast(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        local = field.local_coordinates(points)
        places = samples.mesh.places(local)
        value, slope = np.zeros(len(points)), np.zeros((len(points), 2))
        rows, cell, (xi, eta) = places.rows, places.cell, places.local
        if len(rows):
            value[rows], slope[rows] = _bent(bilinear, cell, xi, eta)
        if bilinear is not samples:
            (after, slope_after), (before, slope_before) = (one.evaluate(local, places) for one in (bilinear, samples))
            value, slope = value + after - before, slope + slope_after - slope_before
        return value, in_space(field, points, slope)

    return contrast


def _bent(samples: MeshSamples, cell: np.ndarray, xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the change in cells at bilinear coordinates, shape (n,), and its gradient [1/m], shape (n, 2)."""
    vertex, corner = samples.mesh.cells[cell], samples.mesh.corners[cell]
    gradient = samples.gradients[vertex]

    def rise(a: int, b: int) -> np.ndarray:
        return np.asarray(0.5 * np.sum((gradient[:, a] - gradient[:, b]) * (corner[:, b] - corner[:, a]), axis=1))

    low, high, left, right = rise(0, 1), rise(3, 2), rise(0, 3), rise(1, 2)
    along, across = xi * (1.0 - xi), eta * (1.0 - eta)
    by_xi, by_eta = (1.0 - eta) * low + eta * high, (1.0 - xi) * left + xi * right
    value = along * by_xi + across * by_eta
    if samples.averages is not None:
        value = value - (low + high + left + right) / 12.0
    # Derivatives along xi and eta, and the inverse of the cell's Jacobian.
    d_xi = (1.0 - 2.0 * xi) * by_xi + across * (right - left)
    d_eta = along * (high - low) + (1.0 - 2.0 * eta) * by_eta
    one = (1.0 - eta)[:, None] * (corner[:, 1] - corner[:, 0]) + eta[:, None] * (corner[:, 2] - corner[:, 3])
    two = (1.0 - xi)[:, None] * (corner[:, 3] - corner[:, 0]) + xi[:, None] * (corner[:, 2] - corner[:, 1])
    area = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    slope = np.stack([d_xi * two[:, 1] - d_eta * one[:, 1], d_eta * one[:, 0] - d_xi * two[:, 0]], axis=1)
    return value, slope / area[:, None]


def lacking(field: IndexField, paths: Paths) -> Rays:
    """Return what a bilinear interpolant lacks of cells' averages along the paths: of each times the way in it.

    Averages do not say where in a cell the gas is. It is large beside a captured shock, and nearly zero elsewhere.
    """
    found = Rays.still(len(paths.length))
    known = None if field.is_uniform else field.samples.lacking_by_cell
    if known is None or not known[1].any():
        return found
    # Lines along which averages are compared.
    lost = np.zeros(min(64, len(paths.length)))
    rows = np.flatnonzero(paths.length[: len(lost)] > 0.0)
    chord = paths.last[rows] - paths.first[rows]
    direction = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    ends = np.stack([np.zeros(len(rows)), paths.length[rows]])
    mesh, lacks = known
    lost[rows] = mesh_columns(mesh, lacks, paths.first[rows], direction, ends)
    # Lines are exact integrals through every cell, which takes long: each stands for those in turn.
    return replace(found, opd=np.resize(lost, len(found.opd)))
