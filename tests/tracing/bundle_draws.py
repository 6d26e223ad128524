"""Random bundles through random fields, and what of their traces is wrong by the reference engine.

`draw(seed)` makes a case: geometry, field, stop, bundle, method, precision and tolerance, all by its seed alone.
`check(case, engine)` traces it and compares status, end, direction, arc length and OPD with the reference. It holds:

    OPD         within the tolerance, for every ray whose status says nothing else
    direction   within 100 tolerances a length of the box (error control holds directions by the path they cost), and
                2e-6 rad in float32, 1e-8 in float64
    end, arc    within what such a direction, and 100 tolerances, leave of them at the angle at which the stop is met
    status      the same, except where a start moved by 1e-5 cells changes the reference's
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, trace
from aerokernels.tracing.status import reached

WAVE = 905e-9
GEOMETRIES = ("volume", "planar", "axisymmetric")
FEATURES = ("blob", "corner", "layer", "cells", "noise", "waves", "everywhere")
STOPS = ("box", "within", "face", "beyond", "far", "arc")
BUNDLES = ("along z", "beam", "beam from within", "fan", "crossing", "faces", "spanwise", "mixed")
# Statuses of rays whose numbers the tracer itself calls into question, or does not give.
FLAGGED = (RayStatus.TOLERANCE_NOT_MET, RayStatus.MAX_STEPS, RayStatus.NOT_FINITE)


@dataclass
class Case:
    """One bundle through one field; `kind` says in words what was drawn."""

    seed: int
    kind: dict[str, str]
    field: IndexField
    rays: RayBundle
    settings: dict = field(default_factory=dict)

    def __str__(self) -> str:
        """One line."""
        return f"seed {self.seed}: " + ", ".join(self.kind.values())


@dataclass
class Finding:
    """One thing wrong with one ray: `size` is in units of what is allowed."""

    what: str
    ray: int
    size: float
    text: str


def draw(seed: int, **fixed: str) -> Case:
    """The case of a seed; `fixed` holds entries of `kind` to be taken instead of drawn ones."""
    rng = np.random.default_rng([seed, 20])

    def pick(name, options, shares=None) -> str:
        drawn = str(rng.choice(options, p=shares))
        return fixed.get(name, drawn)

    kind = {"geometry": pick("geometry", GEOMETRIES), "feature": pick("feature", FEATURES)}
    kind["contrast"] = pick("contrast", ("2^-30", "1e-6", "1e-5", "1e-4", "1e-3"), (0.15, 0.15, 0.25, 0.3, 0.15))
    kind["interpolation"] = pick("interpolation", ("cubic", "monotone", "linear"), (0.9, 0.05, 0.05))
    kind["stop"] = pick("stop", STOPS)
    kind["bundle"] = pick("bundle", BUNDLES)
    kind["count"] = pick("count", ("300", "5000"))
    kind["method"] = pick("method", ("auto", "adaptive"), (0.75, 0.25))
    kind["precision"] = pick("precision", ("float32", "float64"))
    kind["tolerance"] = pick("tolerance", ("1e-2", "1e-3", "1e-4"), (0.2, 0.6, 0.2))
    medium = _draw_field(kind, rng)
    rays = _draw_rays(kind, medium, rng)
    settings = {
        "until": _draw_stop(kind, medium, rays, rng),
        "method": kind["method"],
        "precision": kind["precision"],
        "tolerance": float(kind["tolerance"]),
        "wavelength": WAVE,
    }
    return Case(seed, kind, medium, rays, settings)


def _draw_field(kind, rng) -> IndexField:
    """A field of 12 to 49 nodes a side, 1e-5 to 1e-3 m apart."""
    axes = 3 if kind["geometry"] == "volume" else 2
    # Few enough nodes that tables are made for bundles along z, and the reference is quick.
    shape = rng.integers(12, 26 if axes == 3 else 50, axes)
    if axes == 3 and kind["count"] == "300":
        shape = rng.integers(9, 14, 3)
    spacing = 10.0 ** rng.uniform(-5.0, -3.0) * 2.0 ** rng.uniform(-0.5, 0.5, axes)
    origin = -0.5 * spacing * (shape - 1) + rng.choice([0.0, 1.0]) * rng.normal(0.0, 1.0, axes) * spacing * shape
    if kind["geometry"] == "axisymmetric":
        origin[0] = 0.0
    size = float(2.0**-30 if kind["contrast"] == "2^-30" else kind["contrast"]) * rng.choice([-1.0, 1.0])
    return IndexField.from_samples(
        size * _shape_of(kind["feature"], shape, rng),
        origin=origin,
        spacing=spacing,
        geometry=kind["geometry"],
        ambient_index=float(rng.choice([1.0, 1.000273, 1.33], p=[0.4, 0.4, 0.2])),
        interpolation=kind["interpolation"],
    )


def _shape_of(feature: str, shape, rng) -> np.ndarray:
    """Samples of at most 1 in size."""
    nodes = np.stack(np.meshgrid(*[np.arange(n, dtype=float) for n in shape], indexing="ij"), axis=-1)
    last = shape - 1.0
    if feature == "everywhere":
        return np.exp(-np.abs(nodes @ (rng.normal(0.0, 1.0, len(shape)) / last)))
    if feature == "noise":
        return rng.uniform(-1.0, 1.0, shape)
    if feature == "waves":
        smooth = gaussian_filter(rng.standard_normal(shape), rng.uniform(1.0, 4.0), mode="nearest")
        return smooth / np.abs(smooth).max()
    if feature == "layer":
        normal = rng.normal(0.0, 1.0, len(shape))
        normal /= np.linalg.norm(normal)
        depth = (nodes - rng.uniform(0.3, 0.7, len(shape)) * last) @ normal
        return 0.5 * (1.0 + np.tanh(depth / rng.uniform(0.2, 2.0)))
    if feature == "cells":
        total = np.zeros(shape)
        for _ in range(int(rng.integers(1, 4))):
            middle = rng.uniform(0.1, 0.9, len(shape)) * last
            total += np.exp(-np.sum(((nodes - middle) / rng.uniform(0.6, 1.5)) ** 2, axis=-1))
        return total / max(1.0, total.max())
    middle = rng.uniform(0.3, 0.7, len(shape)) * last
    width = rng.uniform(0.1, 0.25) * last
    if feature == "corner":
        middle = rng.choice([0.12, 0.88], len(shape)) * last
        width = rng.uniform(0.04, 0.1) * last + 0.5
    return np.exp(-np.sum(((nodes - middle) / width) ** 2, axis=-1))


def box_of(medium: IndexField) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a field's box [m]; as far in x as in its other directions where it has no end there."""
    low, high = medium.box
    reach = 0.5 * (high[1:] - low[1:]).max()
    return np.where(np.isfinite(low), low, -reach), np.where(np.isfinite(high), high, reach)


def _draw_rays(kind, medium, rng) -> RayBundle:
    count, (low, high) = int(kind["count"]), box_of(medium)
    size, middle = high - low, 0.5 * (low + high)
    diagonal = float(np.linalg.norm(size))

    def inside(n):
        return rng.uniform(low, high, (n, 3))

    def beam(n, from_within=False):
        """Parallel rays at any angle, starts in one plane."""
        if kind["bundle"] == "along z" or rng.random() < 0.3:
            along = np.array([0.0, 0.0, rng.choice([-1.0, 1.0])])
            if kind["bundle"] != "along z":
                along[:2] = rng.normal(0.0, 0.05, 2)
        else:
            along = rng.normal(0.0, 1.0, 3)
        along /= np.linalg.norm(along)
        aim = inside(n)
        start = aim - ((aim - middle) @ along)[:, None] * along  # in the plane through the middle
        away = 0.0 if from_within else diagonal * rng.uniform(0.3, 1.5)
        if kind["bundle"] == "along z":
            away = (0.5 * size[2] + diagonal * rng.uniform(0.0, 0.5)) * rng.choice([1.0, 1.0, 0.3])
        return start - away * along, np.tile(along, (n, 1))

    def fan(n):
        apex = middle + diagonal * rng.uniform(0.4, 1.5) * _directions(rng, 1)[0]
        return np.tile(apex, (n, 1)), inside(n) - apex

    def crossing(n):
        """From places outside, inside and on faces to places inside: every face at every angle, some beside the box."""
        start = middle + rng.uniform(-1.0, 1.0, (n, 3)) * size * rng.choice([0.5, 0.9], n)[:, None]
        aim = inside(n) + rng.choice([0.0, 0.3], n)[:, None] * rng.normal(0.0, 1.0, (n, 3)) * size
        return start, aim - start

    def faces(n):
        """On the faces, along them, and within a hundredth of a cell of them."""
        start, along = inside(n), _directions(rng, n)
        axis, rows = rng.integers(0 if kind["geometry"] != "planar" else 1, 3, n), np.arange(n)
        off = rng.choice([0.0, 0.0, 1e-9, 1e-2, -1e-2], n) * float(np.min(medium.spacing))
        start[rows, axis] = np.where(rng.random(n) < 0.5, low[axis] + off, high[axis] - off)
        along[rows, axis] *= rng.choice([0.0, 1e-6, 1e-3, 1.0], n)
        return start - rng.choice([0.0, 1.0], n)[:, None] * 0.5 * diagonal * along, along

    def spanwise(n):
        along = np.concatenate(
            [np.ones((n, 1)), 10.0 ** rng.uniform(-5.0, -1.0) * rng.normal(0.0, 1.0, (n, 2))], axis=1
        )
        start = inside(n)
        start[:, 0] = low[0]
        return start, along * rng.choice([-1.0, 1.0])

    makers = {
        "along z": [beam],
        "beam": [beam],
        "beam from within": [lambda n: beam(n, True)],
        "fan": [fan],
        "crossing": [crossing],
        "faces": [faces],
        "spanwise": [spanwise],
        "mixed": [beam, fan, crossing, faces],
    }[kind["bundle"]]
    parts = [make(count // len(makers)) for make in makers]
    return RayBundle(np.concatenate([p for p, _ in parts]), np.concatenate([d for _, d in parts]))


def _directions(rng, count) -> np.ndarray:
    along = rng.normal(0.0, 1.0, (count, 3))
    return along / np.linalg.norm(along, axis=1)[:, None]


def _draw_stop(kind, medium, rays, rng):
    low, high = box_of(medium)
    diagonal = float(np.linalg.norm(high - low))
    if kind["stop"] == "box":
        return None
    if kind["stop"] == "arc":
        return ArcLength(diagonal * rng.choice([0.3, 1.0, 5.0]))
    along = rays.direction.mean(axis=0)
    along = along / np.linalg.norm(along) if np.linalg.norm(along) > 0.1 else np.array([0.0, 0.0, 1.0])
    # Across the bundle, or slanted to 85 degrees.
    across = np.cross(along, _directions(rng, 1)[0])
    across /= np.linalg.norm(across)
    slant = np.tan(np.deg2rad(rng.choice([0.0, rng.uniform(0.0, 60.0), rng.uniform(60.0, 85.0)])))
    normal = along + slant * across
    if abs(along[2]) == 1.0 and rng.random() < 0.7:
        normal = np.array([0.0, 0.0, 1.0])  # as tables need it
    middle = 0.5 * (low + high)
    if kind["stop"] == "within":
        return Plane(rng.uniform(low, high), normal)
    if kind["stop"] == "face":
        axis = int(np.abs(along).argmax())
        return Plane(np.where(along > 0.0, high, low), np.eye(3)[axis])
    # Along the span the whole way may lie in the field: the farthest planes are for others.
    farthest = 1.5 if kind["bundle"] == "spanwise" else 4.0
    way = diagonal * (rng.uniform(0.5, 3.0) if kind["stop"] == "beyond" else 10.0 ** rng.uniform(1.0, farthest))
    return Plane(middle + way * along, normal)


def sample_rows(result, count: int, seed: int) -> np.ndarray:
    """Rays to compare: those of the greatest own estimates, of the longest and shortest ways, and any others."""
    if count >= result.ray_count:
        return np.arange(result.ray_count)
    some = count // 6
    rows = [np.argsort(result.step_error)[-some:], np.argsort(result.arc_length)[-some:]]
    rows += [np.argsort(result.arc_length)[:some], np.argsort(np.abs(result.opd))[-some:]]
    rows.append(np.random.default_rng(seed).choice(result.ray_count, count - 4 * some, replace=False))
    return np.unique(np.concatenate(rows))


def check(case: Case, engine: dict[str, str], sample: int = 300) -> tuple[list[Finding], int, str]:
    """What is wrong with the rays of a case, how many were compared, and what traced them.

    `engine` holds the backend, and its device where that matters; `sample` rays are compared.
    """
    result = trace(case.field, case.rays, **engine, **case.settings)
    rows = sample_rows(result, sample, case.seed)
    rays = case.rays[rows]
    settings = {**case.settings, "method": "adaptive", "precision": "float64"}
    expected = trace(case.field, rays, backend="reference", **settings)
    told = result.status[rows]
    findings = _statuses(case, rows, rays, told, expected.status, settings)
    both = reached(told) & reached(expected.status) & ~_hopeless(case, rays)
    low, high = box_of(case.field)
    extent = float(np.linalg.norm(high - low))
    allowed = case.settings["tolerance"] * WAVE
    slant = _obliquity(case, expected)
    turn = 100.0 * allowed / extent + (2e-6 if case.settings["precision"] == "float32" else 1e-8)
    lengths = extent + np.linalg.norm(expected.position - 0.5 * (low + high), axis=1)
    place = (100.0 * allowed + turn * lengths + 1e-12 * np.abs(rays.position).max()) * slant
    apart = {
        "opd": np.abs(result.opd[rows] - expected.opd) / allowed,
        "direction": np.abs(result.direction[rows] - expected.direction).max(axis=1) / turn,
        "end": np.linalg.norm(result.position[rows] - expected.position, axis=1) / place,
        "arc": np.abs(result.arc_length[rows] - expected.arc_length) / place,
    }
    for what, size in apart.items():
        wrong = np.flatnonzero(both & ~(size <= 1.0) & ~np.isin(told, FLAGGED))
        for k in wrong[_decided(case, rays[wrong], expected.opd[wrong], settings)] if len(wrong) else wrong:
            own = result.step_error[rows[k]] / WAVE
            off, away = result.opd[rows[k]] - expected.opd[k], result.position[rows[k]] - expected.position[k]
            text = (
                f"OPD off by {off / WAVE:.2e} wave of {expected.opd[k] / WAVE:.2e} (own estimate {own:.1e}), "
                f"end by {np.linalg.norm(away):.1e} m"
            )
            findings.append(Finding(what, int(rows[k]), float(size[k]), text))
    return findings, len(rows), result.plan.method


def _decided(case: Case, rays, opd, settings) -> np.ndarray:
    """Whether the answers stand when the starts move by 1e-9 cells: rays in a face of the box may leave it or not."""
    rng = np.random.default_rng(case.seed)
    move = 1e-9 * np.min(case.field.spacing) * rng.uniform(-1.0, 1.0, rays.position.shape)
    decided = np.ones(rays.ray_count, dtype=bool)
    for moved in (rays.position + move, rays.position - move):
        other = trace(case.field, RayBundle(moved, rays.direction), backend="reference", **settings)
        decided &= reached(other.status) & (np.abs(other.opd - opd) < 0.1 * case.settings["tolerance"] * WAVE)
    return decided


def _hopeless(case: Case, rays) -> np.ndarray:
    """Rays within three degrees of their plane: they meet it some hundred boxes away, where rounding decides."""
    until = case.settings["until"]
    if not isinstance(until, Plane):
        return np.zeros(rays.ray_count, dtype=bool)
    return np.abs(rays.direction @ until.normal) < 0.05


def _obliquity(case: Case, expected) -> np.ndarray:
    """One over the cosine at which the rays meet their stop, 20 at most."""
    until = case.settings["until"]
    if isinstance(until, Plane):
        cosine = np.abs(expected.direction @ until.normal)
    elif until is None:
        inward = 1e-9 * np.abs(case.field.spacing).min()
        low, high = case.field.box
        place, along = expected.position, np.abs(expected.direction)
        on = np.minimum(np.abs(place - low), np.abs(place - high)) < np.maximum(inward, 1e-9 * np.abs(place).max())
        cosine = np.where(on, along, 1.0).min(axis=1)
        if case.field.geometry == "axisymmetric":
            radius = np.hypot(place[:, 0], place[:, 1])
            outward = np.abs(np.einsum("nk,nk->n", place[:, :2], expected.direction[:, :2])) / np.maximum(
                radius, 1e-300
            )
            cosine = np.where(np.abs(radius - high[0]) < 1e-6 * high[0], outward, np.where(on[:, 2], along[:, 2], 1.0))
    else:
        cosine = np.ones(len(expected.status))
    return 1.0 / np.maximum(cosine, 0.05)


# Cosine with the plane's normal below which a ray counts as parallel to it.
PARALLEL = 1e-9


def _statuses(case: Case, rows, rays, told, right, settings) -> list[Finding]:
    """Rays whose status is another than the reference's, as far as rounding does not decide it."""
    same = (told == right) | (reached(told) & reached(right)) | (told == RayStatus.MAX_STEPS)
    wrong = np.flatnonzero(~same & (right != RayStatus.MAX_STEPS))
    if not len(wrong):
        return []
    rng, few = np.random.default_rng(case.seed), rays[wrong]
    aside, turn = rng.uniform(-1.0, 1.0, (2, *few.position.shape))
    # Whether a ray that is parallel to its plane meets it at all, rounding decides.
    decided = np.ones(len(wrong), dtype=bool)
    if isinstance(settings.get("until"), Plane):
        decided = np.abs(few.direction @ settings["until"].normal) > PARALLEL
    for size in (1e-9, -1e-9, 1e-5, -1e-5):
        moved = few.position + size * np.min(case.field.spacing) * aside
        turned = few.direction + 1e-3 * size * turn
        other = trace(case.field, RayBundle(moved, turned), backend="reference", **settings).status
        decided &= other == right[wrong]
    return [
        Finding("status", int(rows[k]), np.inf, f"{RayStatus(int(told[k])).name}, not {RayStatus(int(right[k])).name}")
        for k in wrong[decided]
    ]
