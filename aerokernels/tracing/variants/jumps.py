"""What the place of jumps between nodes, which no order of interpolation shows, may change.

A sum over nodes h apart sees what the field has at the wave number 2 pi / h; thinned by j it sees 2 pi / (j h). How
the changes by two, three and four decay tells what is left in the sum over all nodes. A step does not decay:
thinned by two it is half a cell off to either side, and 1 / sqrt(3) of that is the rms of a place drawn in its cell.
"""

import numpy as np

from ...medium import IndexField
from .paths import Paths
from .rays import Cause, Rays

# Draws of the jumps' place.
DRAWS = 8
# Disagreement of two decays, as a logarithm, with those of a shock tanh(x / w), from which they count less; at twice
# of it they do not count.
ONE_LAW = 0.25
# Widths of shocks [cells] whose decays are compared.
WIDTHS = np.linspace(1e-3, 8.0, 4000)
# Rays about a ray from which its size is taken, and its decay; rays and steps in distance by which likeness is found.
NEAR, NEAR_DECAY, COMPARED, BINS = 12, 64, 512, 25


def left_over(size: dict[int, np.ndarray]) -> np.ndarray:
    """Return the change of sums over all nodes over that of sums thinned by two, from the rms changes by 2, 3 and 4.

    They are over those of a step, each of shape (n,). The result rises to 1 where the three are not of one shock:
    kinks, or several structures.
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
    return np.asarray(np.minimum(1.0, np.sqrt(3.0) * share) ** np.clip(2.0 - off / ONE_LAW, 0.0, 1.0))


def jumps(field: IndexField, paths: Paths, thinned: tuple[tuple[Rays, dict[int, np.ndarray]], ...]) -> Cause:
    """Return the change by the place of jumps, and draws of it.

    Args:
        field: The refractive index.
        paths: The rays' paths.
        thinned: Changes of sums over every second node, and the sizes of those by two, three and four.
    """
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
    """Return draws of an optical path: its size at each ray [m], (n,), times smooth patterns of rms 1.

    Their wavelengths are those of the steps that a jump makes across the rows of nodes, two to eight lengths [m] over
    which the path is `alike`, but four cells to two widths of the bundle.
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
