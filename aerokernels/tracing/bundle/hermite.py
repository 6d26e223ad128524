r"""Bicubic Hermite patches on blocks of four by four cells, whose slopes are differences of fourth order.

On a cell of side 1, with u in [0, 1] and v = 1 - u,

    f(u) = (1 + 2 u) v^2 f0 + u v^2 f0' + u^2 (3 - 2 u) f1 - u^2 v f1'

has an error of f''''/384, like a cubic spline, but its slopes use only two nodes to each side, so that a rough place
affects only its neighbourhood. A slope is the derivative of the quartic through five nodes: those centred on its own
node where they exist, otherwise the nearest five of the block.
"""

import numpy as np

# Cells and nodes of a block along each axis, and nodes beyond it that slopes may use.
CELLS = 4
NODES = CELLS + 1
BESIDE = 2
WINDOW = NODES + 2 * BESIDE
# Nodes of a block once its cells are halved.
FINER = 2 * CELLS + 1


def slope_matrix(has_low: bool, has_high: bool) -> np.ndarray:
    """The matrix from the values at nodes -2 to 6 of a line through a block to the slopes at nodes 0 to 4 [per cell].

    `has_low` and `has_high` say whether the nodes beyond the ends of the block may be used.
    """
    first, last = (0 if has_low else BESIDE), (WINDOW if has_high else WINDOW - BESIDE) - 5
    matrix = np.zeros((NODES, WINDOW))
    for node in range(NODES):
        begin = int(np.clip(node, first, last))  # the centred five begin two nodes before, which is index `node`
        place = np.arange(begin, begin + 5) - (node + BESIDE)
        powers = np.vander(place.astype(float), 5, increasing=True)
        matrix[node, begin : begin + 5] = np.linalg.inv(powers)[1]
    return matrix


SLOPES = {(low, high): slope_matrix(low, high) for low in (False, True) for high in (False, True)}
OWN_SLOPES = SLOPES[False, False][:, BESIDE : BESIDE + NODES]


def hermite_weights(u: np.ndarray) -> np.ndarray:
    """Weights of value and slope at 0 and at 1, shape (4, *u.shape)."""
    v = 1.0 - u
    return np.stack([(1.0 + 2.0 * u) * v * v, u * v * v, u * u * (3.0 - 2.0 * u), -u * u * v])


def _finer_matrices() -> tuple[np.ndarray, np.ndarray]:
    values, slopes = np.zeros((FINER, NODES)), np.zeros((FINER, NODES))
    for row in range(FINER):
        cell = min(row // 2, CELLS - 1)
        found = hermite_weights(np.asarray(0.5 * row - cell))
        values[row, cell], slopes[row, cell], values[row, cell + 1], slopes[row, cell + 1] = found
    return values, slopes


FINER_VALUES, FINER_SLOPES = _finer_matrices()


def patches(window: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Values and slopes at the nodes of blocks.

    Args:
        window: Values at the nodes of each block and two beyond, shape (n, 9, 9, channels); nodes that are not usable
            may hold anything but NaN.
        usable: Which nodes may be used, shape (n, 9, 9); those of a block itself always are.

    Returns:
        Value, slopes along both axes and mixed slope [per cell], shape (n, 5, 5, 4, channels).
    """
    inner = slice(BESIDE, BESIDE + NODES)
    made = np.empty((len(window), NODES, NODES, 4, window.shape[-1]))
    made[..., 0, :] = window[:, inner, inner]
    for axis, lines in ((0, window[:, :, inner]), (1, np.moveaxis(window[:, inner], 1, 2))):
        free = usable[:, :, inner] if axis == 0 else np.moveaxis(usable[:, inner], 1, 2)
        low, high = free[:, :BESIDE].all(axis=(1, 2)), free[:, -BESIDE:].all(axis=(1, 2))
        for case, matrix in SLOPES.items():
            rows = np.flatnonzero((low == case[0]) & (high == case[1]))
            if len(rows):
                slope = np.einsum("ij,njkc->nikc", matrix, lines[rows], optimize=True)
                made[rows, :, :, 1 + axis] = slope if axis == 0 else np.moveaxis(slope, 1, 2)
    made[..., 3, :] = np.einsum("ij,nkjc->nkic", OWN_SLOPES, made[..., 1, :], optimize=True)
    return made


def finer(made: np.ndarray) -> np.ndarray:
    """The patches evaluated at the nodes of cells half as wide, shape (n, 9, 9, channels)."""
    values, slopes = FINER_VALUES, FINER_SLOPES
    along = np.einsum("ai,nijpc->najpc", values, made[..., (0, 2), :], optimize=True)
    along += np.einsum("ai,nijpc->najpc", slopes, made[..., (1, 3), :], optimize=True)
    found = np.einsum("bj,najc->nabc", values, along[..., 0, :], optimize=True)
    found += np.einsum("bj,najc->nabc", slopes, along[..., 1, :], optimize=True)
    return np.asarray(found)
