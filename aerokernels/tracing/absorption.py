r"""Integrate the absorption coefficient along traced rays: transmission = exp(-\int kappa ds).

The path in the box is cut in parts, whose ends are those of the rays traced again part by part; within a part it is the
cubic through both ends and tangents, and kappa is taken at three Gauss points a cell. In a field that bends no ray one
part is enough. Engines only trace, so the integral is the same for all of them.
"""

from typing import Any

import numpy as np

from ..medium import IndexField
from ..medium.absorption import Absorption
from ..process.threads import in_threads
from ..rays import RayBundle
from .cuts import GAUSS
from .launch import run_plan
from .lines import box_size, box_span
from .plan import TracePlan
from .planning import plan_bundle
from .stop import ArcLength, RayStatus

# Cells of a part of a path, and the greatest number of parts. A part's cubic is then within 1e-3 of a cell.
PART_CELLS, MOST_PARTS = 8, 64
OUTPUTS = ("position", "direction", "arc_length")
# Points that a thread evaluates together.
POINTS = 1 << 16


def absorbs(field: IndexField) -> bool:
    """Whether the gas of a field absorbs."""
    return field.upstream is not None and field.upstream.absorption is not None


def transmission(field: IndexField, rays: RayBundle, until: Any, result: Any) -> np.ndarray:
    """Return the share of each ray's power that arrives where it ended, shape (ray_count,); NaN for a failed ray."""
    known = result.ends is not None and result.arc_length is not None
    ends = (*result.ends, result.arc_length) if known else None
    share = np.exp(-depths(field, rays, result.plan, until, result.wavelength, ends))
    ended = result.ok | (np.asarray(result.traced_status) == RayStatus.HIT_BODY)
    return np.where(ended, share, np.nan)


def amplitudes(field: IndexField, rays: RayBundle, plan: TracePlan, until: Any, wavelength: float) -> np.ndarray:
    """Return the share of each ray's amplitude that the gas does not absorb, shape (n,), 0 where it is not known."""
    return np.nan_to_num(np.exp(-0.5 * depths(field, rays, plan, until, wavelength)))


def depths(field: IndexField, rays: RayBundle, plan: TracePlan, until: Any, wavelength: float, ends=None) -> np.ndarray:
    """Return the integral of the absorption coefficient along each ray, shape (ray_count,).

    `ends` are the rays' end points [m] and directions there, both (ray_count, 3), and lengths [m], if they are known.
    """
    assert field.upstream is not None and field.upstream.absorption is not None
    absorption: Absorption = field.upstream.absorption
    end, way, length = _brought(field, rays, plan, until, wavelength) if ends is None else ends
    margin = 1e-9 * box_size(field)
    there = box_span(field, rays.position, rays.direction)
    back = box_span(field, end + margin * way, -way)
    meets = there.meets & (there.enter < length)
    first = np.where(meets, there.enter, 0.0)
    behind = np.where(meets & back.meets, np.maximum(back.enter - margin, 0.0), 0.0)
    inside = np.where(meets, np.maximum(length - first - behind, 0.0), 0.0)
    depth = absorption.ambient * (length - inside)

    rows = np.flatnonzero(meets & (inside > 0.0))
    point, tangent = rays.position[rows] + first[rows, None] * rays.direction[rows], rays.direction[rows]
    left, last, last_way = inside[rows], (end - behind[:, None] * way)[rows], way[rows]
    straight = not np.ptp(field.samples.extremes if field.is_uniform else field.samples.values)
    longest = float(left.max(initial=0.0))
    parts = 1 if straight else int(np.clip(np.ceil(longest / (PART_CELLS * absorption.spacing)), 4, MOST_PARTS))
    part = ArcLength(longest / parts) if len(rows) else None
    while part is not None and len(rows):
        goes_on = left > part.length * (1.0 + 1e-9)
        after, way_after = last.copy(), last_way.copy()
        if goes_on.any():
            bundle = RayBundle(point[goes_on], tangent[goes_on])
            after[goes_on], way_after[goes_on], _ = _brought(field, bundle, plan, part, wavelength)
        here = np.where(goes_on, part.length, left)
        depth[rows] += _integrals(absorption, point, tangent, after, way_after, here)
        rows, point, tangent, left = rows[goes_on], after[goes_on], way_after[goes_on], (left - part.length)[goes_on]
        last, last_way = last[goes_on], last_way[goes_on]
    return depth


def _brought(field: IndexField, rays: RayBundle, like: TracePlan, until: Any, wavelength: float) -> Any:
    """Return where rays end [m], their directions there and their lengths [m], traced as well as a plan does it."""
    length = until.length if isinstance(until, ArcLength) else None
    plan = plan_bundle(
        field, rays, until, method="auto", step=None, wavelength=wavelength, backend=like.backend, device=like.device,
        precision=like.precision, tolerance=like.tolerance, max_steps=None, path_length=length,
    )  # fmt: skip
    arrays = run_plan(field, rays, plan, until, wavelength, frozenset(OUTPUTS))
    return tuple(np.asarray(arrays[name]) for name in OUTPUTS)


def _integrals(absorption: Absorption, start, tangent, end, end_tangent, length: np.ndarray) -> np.ndarray:
    """Integrals of the coefficient along the cubics of parts, shape (n,); lengths [m]."""
    result = np.zeros(len(length))
    cells = max(1, int(np.ceil(length.max(initial=0.0) / absorption.spacing)))
    u = np.concatenate([(np.arange(cells) + place) / cells for place, _ in GAUSS])
    weight = np.repeat([weight / cells for _, weight in GAUSS], cells)
    basis = np.stack([(1.0 + 2.0 * u) * (1.0 - u) ** 2, u * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)])
    chunk = max(1, POINTS // len(u))

    def add(first: int) -> None:
        some = slice(first, first + chunk)
        size = length[some, None]
        ends = np.stack([start[some], size * tangent[some], end[some], size * end_tangent[some]], axis=1)
        points = np.einsum("km,nkx->nmx", basis, ends)
        result[some] = length[some] * (absorption.inside(points.reshape(-1, 3)).reshape(points.shape[:2]) @ weight)

    in_threads(add, range(0, len(length), chunk))
    return result
