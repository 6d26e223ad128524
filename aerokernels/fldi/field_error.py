"""Error of a phase by the field: its samples, its source and its model.

The phase difference of both beams is computed again about some of the focus's places, each moved within a cell: beams
are often narrower than a cell, where a change may vanish by chance. Few rays stand for a beam; each goes straight to
the focus and from there, and changes along its way by each cause (tracing/variants). A place's error is the root mean
square over the nearest ones.
"""

from itertools import pairwise

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing.cuts import lost
from ..tracing.lines import cell_along
from ..tracing.some_pixels import STUDENT, total
from ..tracing.stop import Plane
from ..tracing.variants.causes import line_variants, of_each
from ..tracing.variants.paths import Paths, Rays, paths_of
from .instrument import FLDI
from .rays import ray_points

# Places of the focus at which the phase is computed again, the nearest of them by which an error is found, and rays
# along both sides of a beam: Gauss's points for its light.
PLACES, NEAR, ACROSS = 12, 12, 4


def field_errors(field: IndexField, instrument: FLDI, focus: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the errors of phases due to the field [rad], shape (n,); NaN where they are not known.

    Args:
        field: The refractive index.
        instrument: The instrument.
        focus: The focus of each phase [m], shape (n, 3).
        ends: Distances from the focus between which light is in the field's box [m], shape (n, 2).
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
    found, missed = [], []
    for begin, end in pairwise(stops):
        way = end - begin
        way = np.where(np.linalg.norm(way, axis=1, keepdims=True) > 0.0, way, instrument.axis)
        rays, until = RayBundle(begin, way), Plane(end[0], instrument.axis)
        found.append(paths_of(field, rays.position, rays.direction, until))
        outward = rays if end is stops[2] else RayBundle(end, -way)
        missed.append(lost(field, outward, None))
    return Paths.joined(found), np.concatenate(missed)
