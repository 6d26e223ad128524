"""Optical paths of bent rays through thin screens, to second order in their displacement."""

import numpy as np

# Margin of pixels around the rays for second derivatives; array elements of screens processed together.
MARGIN, TOGETHER = 2, 1 << 14


def bending(paths: np.ndarray, pixel: float, step: float, after: float) -> np.ndarray:
    r"""Return the excess optical path of bent rays over straight ones through screens [m], at the start of each ray.

    To second order in d, rays with deflection t and displacement d get from a screen of path p

        p + d grad p + d H d / 2,       t += grad p + H d,       d += t z,

    and t^2 z / 2 from their slanted path through free space of a length z. Neglected terms are of third order in d over
    the size of a feature.

    Args:
        paths: Optical path of each slab [m], shape (count, rows, columns).
        pixel: Side of a pixel [m].
        step: Thickness of a slab [m].
        after: Free distance behind the last slab [m].

    Returns:
        Excess path [m], shape (rows, columns); zero in a margin of MARGIN pixels, which derivatives do not reach.
    """
    kind, shape = paths.dtype.type, paths.shape[1:]
    axes = [axis for axis in (0, 1) if shape[axis] > 1]
    reach = kind(max(shape) * pixel)
    excess = np.zeros(shape, dtype=kind)
    gained = _inner(excess, axes, MARGIN)
    turn, aside = np.zeros((2, len(axes), *gained.shape), dtype=kind)
    some = max(1, TOGETHER // paths[0].size)
    for first in range(0, len(paths), some):
        part = paths[first : first + some]
        wide = [_slope(part, pixel, axis, axes) for axis in axes]
        slopes = [_inner(each, axes, 1) for each in wide]
        # The first slab meets rays that are not yet displaced.
        bent = slice(1 if first == 0 else 0, None)
        curvatures = _curvatures([each[bent] for each in wide], pixel, axes) if len(paths) > 1 else []
        for number in range(len(part)):
            if first + number > 0:
                more = _times_curvature([each[number - bent.start] for each in curvatures], aside)
                for own, moved, change in zip(slopes, aside, more, strict=True):
                    gained += moved * (own[number] + kind(0.5) * change)
                    own[number] += change
            is_last = first + number == len(paths) - 1
            distance = kind(0.5 * step + after if is_last else step)
            for turned, moved, own in zip(turn, aside, slopes, strict=True):
                turned += own[number]
                gained += kind(0.5) * distance * turned**2
                if not is_last:
                    moved += distance * turned
                    # Slopes of the jump at the box's side, where there is no light, must not overflow.
                    np.minimum(np.maximum(moved, -reach, out=moved), reach, out=moved)
    return excess


def _inner(values: np.ndarray, axes: list[int], margin: int) -> np.ndarray:
    """Return maps (..., rows, columns) without a margin of pixels along the axes."""
    rows, columns = (slice(margin, -margin) if axis in axes else slice(None) for axis in (0, 1))
    return values[..., rows, columns]


def _slope(paths: np.ndarray, pixel: float, axis: int, axes: list[int]) -> np.ndarray:
    """Return central differences over the pixel along one axis of maps (count, rows, columns), without a margin of one.

    The margin is left out along all `axes`.
    """
    ahead, behind = ([slice(1, -1) if own in axes else slice(None) for own in (0, 1)] for _ in range(2))
    ahead[axis], behind[axis] = slice(2, None), slice(None, -2)
    made = paths[:, *ahead] - paths[:, *behind]
    made *= made.dtype.type(0.5 / pixel)
    return made


def _curvatures(slopes: list[np.ndarray], pixel: float, axes: list[int]) -> list[np.ndarray]:
    """Return second derivatives of the screens' paths: along each axis, then mixed."""
    own = [_slope(each, pixel, axis, axes) for each, axis in zip(slopes, axes, strict=True)]
    return [*own, _slope(slopes[0], pixel, 1, axes)] if len(axes) > 1 else own


def _times_curvature(curvatures: list[np.ndarray], aside: np.ndarray) -> list[np.ndarray]:
    """Return the second derivatives of a screen's path times displacements."""
    if len(aside) == 1:
        return [curvatures[0] * aside[0]]
    along_y, along_x, mixed = curvatures
    return [along_y * aside[0] + mixed * aside[1], along_x * aside[1] + mixed * aside[0]]
