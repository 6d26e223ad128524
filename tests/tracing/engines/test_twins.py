"""Device functions of the Warp and the OpenCL kernels give the same numbers, bit for bit in float64.

Set-up: every function that both engines have (scripts/kernel_arguments holds their names and arguments together),
called on each engine's CPU with the same random arguments: cells and places in and about a field, unit vectors with and
without zeros, surfaces, statuses, for grids and meshes of all geometries, interpolations, methods and stops.

Expected: equal bits. OpenCL's compiler may contract a product and a sum into one rounding, which Warp's does not on a
CPU; the functions are compared as they are written, with that switched off. BOUNDS has the few that are written
otherwise on the two sides, and why; tolerances are units in the last place of the greatest number that they give.
"""

import shutil
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.stop import ArcLength, Plane
from tests.bodies import star
from tests.random_fields import CELL, mesh_field, uniform_field

from ..opencl_stands import need_opencl

wp = pytest.importorskip("warp")
from .twin_programs import FIRST, STRUCTS, Twin, opencl_text, program, run_opencl, run_warp, width  # noqa: E402

ROWS = 192
STOPS = {"none": None, "plane": Plane((0.0, 0.0, 5e-3), (0.0, 0.3, 1.0)), "arc": ArcLength(4.2e-3)}
# Geometry, interpolation, method and stop. A function that several of them have is called in the first of them.
SCENES = {
    "volume": ("volume", "cubic", "adaptive", "plane"),
    "planar": ("planar", "linear", "straight", "none"),
    "axisymmetric": ("axisymmetric", "cubic", "paper", "arc"),
    "mesh": ("planar", "bilinear-barron", "paper", "none"),
    "monotone": ("axisymmetric", "monotone", "adaptive", "plane"),
    "idw": ("axisymmetric", "idw", "fixed", "plane"),
    "edges": ("planar", "bilinear", "adaptive", "plane"),
    "conical edges": ("axisymmetric", "bilinear", "straight", "plane"),
}
SUM = "OpenCL sums rows of the support as vectors, and takes their scalar product at the end"
ORDER = "sums of three or four terms are associated otherwise"
# Units in the last place by which functions may differ, and why.
BOUNDS = {
    "sample": (64, SUM),
    "sample_in": (64, SUM),
    "plane_sample": (64, SUM),
    "sample_at_stage": (128, SUM),
    "sample_neglected": (128, SUM),
    "in_cell": (16, SUM),
    "blend": (4, SUM),
    "step_sums": (16, ORDER),
    "step_error": (2, ORDER),
    "event_location_error": (4, ORDER),
    "step_acceptance": (2, "a fourth root: a power in Warp, two square roots in OpenCL"),
    "stop_geometry_of": (2, "a power: each engine has the one of its mathematical library"),
}


def scene_field(name: str) -> IndexField:
    """A random field; grids of two dimensions have a spiked body."""
    geometry, interpolation, _, _ = SCENES[name]
    if interpolation in ("cubic", "linear", "monotone"):
        field = uniform_field(geometry, interpolation)
        if geometry == "volume":
            return field
        corners = star(np.random.default_rng(1), geometry, 6e-4)
        profile = np.array([corners.profile[:, 0], corners.profile[:, 1] + 1.5e-3]).T
        options = {
            "origin": field.samples.origin,
            "spacing": field.samples.spacing,
            "ambient_index": field.ambient_index,
        }
        samples = field.samples.samples
        return IndexField.from_samples(
            samples, geometry=geometry, interpolation=interpolation, body=Body(profile, geometry), **options
        )
    return mesh_field(interpolation, geometry)


class Numbers:
    """Random arguments of a function by name and kind; another function's do not change them."""

    def __init__(self, field: IndexField, function: str):
        """Those that fit a field."""
        self.rng = np.random.default_rng(zlib.crc32(function.encode()))
        self.field = field
        grid = field.samples.samples.shape if field.is_uniform else (1,)
        self.axes = len(grid)
        self.cells = (*grid, 1)[:2] if field.geometry != "volume" else grid
        self.cell_count = 1 if field.is_uniform else len(field.samples.mesh.cells)
        links = field.body.tree.links if field.body is not None else np.ones((1, 3), dtype=int)
        self.wall_nodes, self.wall_pieces = len(links), int(links[:, 2].max())

    def __call__(self, name: str, kind: str, function: str) -> np.ndarray:
        """Values of an argument, shape (ROWS, numbers in it)."""
        uniform, integers = self.rng.uniform, self.rng.integers
        count = width(kind)
        shape = (ROWS, count)
        if kind in STRUCTS:
            return np.hstack([self(member.name, member.kind, kind) for member in STRUCTS[kind]])
        if kind == "bool":
            return integers(0, 2, shape)
        if kind == "uint":
            return integers(0, 2**32, shape)
        if kind == "int":
            return self.whole(name, function)
        if kind == "int3":
            return integers(0, 6 if function.startswith("sample") else 26, shape)
        if name in ("d", "direction", "heading"):
            return self.directions()[:, :count]
        if name == "total":
            return self.directions() * uniform(0.9, 1.1, (ROWS, 1))
        if name == "rate":
            return np.full(shape, 1.0 / CELL if self.field.is_uniform else 1.0)
        if name == "frac" and function.startswith("sample") and self.field.is_uniform:  # within the grid
            return uniform([-14.0 if self.field.geometry == "axisymmetric" else 0.0, 0.0, 0.0], 20.0, shape)
        if name in ("p", "here", "frac", "at") and count > 1:
            cells = name == "frac" and self.field.is_uniform
            place = uniform([-1.6e-3] * 3, [1.6e-3, 1.6e-3, 4.2e-3], (ROWS, 3)) / (CELL if cells else 1.0)
            return place[:, 1:] if count == 2 else place
        if name in ("s2", "s3", "s4"):
            return np.hstack([uniform(-1e-3, 1e-3, (ROWS, 1)), uniform(-2.0, 2.0, (ROWS, 3))])
        if name in ("box", "segment", "s"):
            corners = np.sort(uniform(0.0, 1.5e-3, (ROWS, 2, 2)), axis=1 if name == "box" else 0)
            return corners.reshape(ROWS, 4)
        low, high = RANGES.get((function, name), RANGES.get(name, (-1e-3, 1e-3)))
        values = uniform(low, high, shape)
        values[::17] = values[::17].round(0 if abs(high) > 1.0 else 4)  # zeros and whole numbers, too
        return values

    def directions(self) -> np.ndarray:
        """Unit vectors: any, near z, and along axes."""
        vectors = self.rng.normal(size=(ROWS, 3))
        vectors[::3] = [0.0, 0.0, 1.0] + 0.02 * vectors[::3]
        vectors[::5, :2] = 0.0
        vectors[::7, 0] = 0.0
        vectors[::11] = np.eye(3)[np.arange(len(vectors[::11])) % 3]
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    def whole(self, name: str, function: str) -> np.ndarray:
        """Whole numbers that lie within what is looked up by them."""
        greatest = {
            "k": FACES[self.field.geometry] + 1,
            "ends_on": FACES[self.field.geometry] + 1,
            "event": FACES[self.field.geometry] + 1,
            "status": 1,
            "cone": 13,
            "axis": self.axes,
            "a": self.cells[0] - 1,
            "b": self.cells[1] - 1,
            "last": 26,
            "base": 26,
            "count": 40,
            "current_cell": self.cell_count,
            "inside": self.cell_count,
            "edge": 4 * self.cell_count,
            "first": 4 * (self.cell_count - 1) + 1,
            "node": self.wall_nodes,
            "piece": self.wall_pieces,
        }.get(name, 20)
        least = -1 if name in ("ends_on", "current_cell", "event") else 1 if name == "per_replicate" else 0
        if name == "cell":
            greatest = 26 if function == "step_bound_block" else self.cell_count
        return self.rng.integers(least, max(greatest, least + 1), (ROWS, 1))


FACES = {"volume": 6, "planar": 4, "axisymmetric": 3}
# Ranges of arguments, where they are not lengths of the field's order; by function where names mean different things.
RANGES = {
    "ambient": (1.0001, 1.0001),
    "index": (0.999, 1.001),
    "force": (-2.0, 2.0),
    "u": (-0.2, 1.2),
    "v": (-0.2, 1.2),
    ("sample_neglected", "q"): (-1e-4, 1e-4),
    ("split", "place"): (-3.0, 30.0),
    ("flat_face", "place"): (-3.0, 30.0),
    ("step_bound_block", "place"): (-3.0, 30.0),
    ("meet_face", "gap"): (0.0, 2.0),
    ("meet_face", "acceleration"): (-1e5, 1e5),
    ("flat_face", "acceleration"): (-1e5, 1e5),
    "velocity": (-1e4, 1e4),
    "acceleration": (-1e6, 1e6),
    "speed": (-1e4, 1e4),
    "h": (1e-6, 3e-4),
    "h_cell": (5e-5, 1e-4),
    "h_least": (1e-9, 1e-8),
    "h_next": (1e-6, 1e-3),
    "h_cap": (1e-6, 1e-3),
    "reach": (1e-3, 5e-3),
    "lever_arm": (1e-3, 1.0),
    "obliquity": (0.0, 2.0),
    "derating": (0.2, 1.0),
    "max_deflection": (0.0, 0.02),
    "tolerance": (0.0, 1e-8),
    "error": (0.0, 1e-8),
    "used": (0.0, 1e-9),
    "rounding": (0.0, 1e-9),
    "direction_weight": (0.0, 1.0),
    "side": (0.5, 1.5),
    "face_tolerance": (0.0, 1e-3),
    "stand_off": (0.0, 1e-3),
    "cosine": (0.0, 1.0),
    "onward": (0.0, 1.0),
    "missed": (0.0, 1e-8),
    "across": (0.0, 1.0),
    "along": (-1.0, 1.0),
    "square": (0.1, 1.0),
    "radius": (1e-4, 2e-3),
    ("crossing", "low"): (-2e-3, 0.0),
    ("crossing", "high"): (1e-3, 4e-3),
    ("WallLine", "first"): (0.0, 1e-6),
    **{(name, "t_exit"): (1e-3, 5e-3) for name in ("has_clearance", "may_enter", "may_enter_triangle", "keep_support")},
    "stop_distance": (1e-3, 5e-3),
    "arc_left": (1e-3, 4e-3),
    "rest": (0.0, 1e-4),
    "sums": (-1e-3, 4e-3),
    "w": (0.0, 0.5),
    ("cylinder", "span"): (-5e-3, 5e-3),
    ("slab", "span"): (-5e-3, 5e-3),
    "carry": (-1e-12, 1e-12),
    "q_carry": (-1e-12, 1e-12),
    "sums_carry": (-1e-12, 1e-12),
    "q": (-1e-5, 1e-5),
    "kick": (-1e-6, 1e-6),
    "allowance": (0.0, 1e-6),
    "margin": (0.0, 1e-4),
}


def twins_of(name: str, scripts) -> list[Twin]:
    """The functions that both engines have in a kind of scene."""
    from aerokernels.tracing.engines.warp.kernels.leapfrog import build_leapfrog_kernel
    from aerokernels.tracing.engines.warp.kernels.trace import build_kernel
    from aerokernels.tracing.engines.warp.library import library_of

    geometry, interpolation, method, stop = SCENES[name]
    on_mesh, library = interpolation not in ("cubic", "linear", "monotone"), library_of("float64")
    kernels = [build_kernel(library, geometry, interpolation, on_mesh, method, stop, True, True)]
    if not on_mesh:
        kernels.append(build_leapfrog_kernel(library, geometry, interpolation, stop, True))
    found = {function.func.__name__: function for kernel in kernels for function in scripts.reached(kernel.func)}
    twins = []
    for word, opencl in scripts.opencl_functions(scripts.FOLDER).items():
        if word not in found or any(kind in scripts.LANES for _, kind in opencl.arguments):
            continue
        not_there = {"write_outputs"} | ({"paper_step"} if method != "paper" else set())
        if word in not_there | ({"blend"} if interpolation == "bilinear" else set()):
            continue
        given = dict(opencl.given)
        arguments = tuple(
            (v.label, "bool" if v.type in (bool, wp.bool) else given[v.label]) for v in found[word].adj.args
        )
        row = "real2" if interpolation == "linear" else "real4"  # Warp's are of four always
        result = [] if opencl.result == "void" else [opencl.result.replace("row_t", row)]
        twins.append(Twin(word, found[word], opencl, arguments, (*result, *(kind for _, kind in opencl.back))))
    return twins


@pytest.fixture(scope="module")
def scripts():
    """scripts/kernel_arguments.py."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "scripts"))
    import kernel_arguments

    sys.path.pop(0)
    return kernel_arguments


@pytest.mark.parametrize("name", SCENES)
def test_twins_give_the_same_bits(name: str, scripts, tmp_path: Path):
    """Differences are counted in units in the last place of the greatest number of a column; NaN equals NaN."""
    from aerokernels.tracing.engines import engine_of
    from aerokernels.tracing.engines.opencl.program import build_options, expand, kernel_folder

    device = need_opencl("cpu").info.device
    before = list(SCENES)[: list(SCENES).index(name)]
    known = {twin.warp for scene in before for twin in twins_of(scene, scripts)}
    twins = [twin for twin in twins_of(name, scripts) if twin.warp not in known]
    geometry, interpolation, method, stop = SCENES[name]
    field = scene_field(name)
    made = program(twins)
    numbers = {twin.name: Numbers(field, twin.name) for twin in twins}
    asked = [(twin.name, *argument) for twin in twins for argument in twin.arguments if argument[0] not in FIRST]
    given = np.hstack([numbers[name](word, kind, name) for name, word, kind in asked]).astype(float)
    plan = TracePlan(method, "warp", "cpu", "float64", 1000, CELL if method == "fixed" else None, 1e-3)
    scene = (field, plan, STOPS[stop], 905e-9, frozenset(["opd"]), np.eye(3))
    shutil.copytree(kernel_folder() / "include", tmp_path / "include")
    (tmp_path / "twins.cl").write_text(opencl_text(made, not field.is_uniform))
    options = build_options(
        precision="float64",
        geometry=geometry,
        interpolation=interpolation,
        method=method,
        stop=stop,
        on_mesh=not field.is_uniform,
        has_body=True,
    )
    engine = engine_of("opencl", device)
    theirs = run_opencl(expand("twins.cl", tmp_path), made, engine, options, engine.arguments(*scene), given)
    ours = run_warp(made, tmp_path, engine_of("warp", "cpu").arguments(*scene), given)
    wrong = {}
    for twin in twins:
        columns = slice(made.out[twin.name], made.out[twin.name] + sum(map(width, twin.results)))
        most = BOUNDS.get(twin.name, (0, ""))[0]
        found = units_apart(ours[:, columns], theirs[:, columns])
        if not found <= most:
            wrong[twin.name] = found
    assert not wrong
    assert np.isfinite(ours).mean() > 0.95


def units_apart(one: np.ndarray, other: np.ndarray) -> float:
    """Greatest difference, in units in the last place of the greatest finite number of a column.

    Not a number only where both are; infinite only where both are, of any sign: it is that of a rounded zero.
    """
    if (np.isnan(one) != np.isnan(other)).any() or (np.isinf(one) != np.isinf(other)).any():
        return np.inf
    finite = np.isfinite(one) & np.isfinite(other)
    one, other = np.where(finite, one, 0.0), np.where(finite, other, 0.0)
    unit = np.spacing(np.maximum(np.abs(one), np.abs(other)).max(axis=0))
    return float((np.abs(one - other) / unit).max())


def test_units_apart_tells_one_bit():
    """The measure of this file: 0 for equal numbers, 1 for the next one, infinite where only one is NaN."""
    row = np.array([[1.0, np.nan, np.inf, 0.0]])
    assert units_apart(row, row * [1.0, 1.0, -1.0, -1.0]) == 0.0
    assert units_apart(row, np.nextafter(row, 2.0, where=[True, False, False, False], out=row.copy())) == 1.0
    assert units_apart(row, np.array([[1.0, 0.0, np.inf, 0.0]])) == np.inf
