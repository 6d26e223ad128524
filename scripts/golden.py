"""Record what the package computes on a fixed list of small cases, or compare two such records.

    scripts/golden record FILE.npz [--only TEXT]      every case's arrays
    scripts/golden compare BEFORE.npz AFTER.npz       what is equal, within the tolerance and beyond it, by how
                                                      much; exit status 1 if any row is beyond it

The tolerance is 1e-15 m in float64 and 1e-4 wave in float32 for lengths and optical paths, as much over a metre for
directions and ratios, and 1e-9 of the peak for echoes; statuses and refusals must be equal, counts of steps may differ.
The cases call public names only, so that a record made by an older commit (in its own worktree, with PYTHONPATH set to
it) can be compared with one made by a newer commit.
"""

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import aerokernels as ak
from aerokernels import ArcLength, Disc, IndexField, Plane, QuadMesh, RayBundle

WAVELENGTH = 905e-9
AMBIENT = 1.0001
CELL = 1e-4
GRIDS = {
    "volume": ((21, 19, 31), (-10e-4, -9e-4, 0.0)),
    "planar": ((19, 31), (-9e-4, 0.0)),
    "axisymmetric": ((19, 31), (0.0, 0.0)),
}
STOPS = {
    "out": None,
    "plane": Plane((0.0, 0.0, 5e-3), (0.0, 0.3, 1.0)),
    "arc": ArcLength(4.2e-3),
}
ENGINES = ("opencl", "warp")
PRECISIONS = ("float64", "float32")
TRACED = ("position", "direction", "optical_path", "opd", "arc_length", "step_error", "step_count", "evaluation_count")

Case = tuple[str, Callable[[], dict[str, np.ndarray]]]


def noise(shape: tuple[int, ...], amplitude: float = 3e-4, width: float = 3.0) -> np.ndarray:
    """Return random samples, smooth over `width` cells."""
    array = gaussian_filter(np.random.default_rng(3).standard_normal(shape), width, mode="nearest")
    return amplitude * array / np.abs(array).max()


def grid_field(geometry: str, interpolation: str = "cubic", fade: bool = False) -> IndexField:
    """Return a uniform grid of random smooth air; with `fade` it vanishes toward every face."""
    shape, origin = GRIDS[geometry]
    samples = noise(shape)
    if fade:
        for axis, count in enumerate(shape):
            window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
            if geometry == "axisymmetric" and axis == 0:
                window = np.cos(0.5 * np.pi * np.arange(count) / count) ** 2
            samples = samples * np.moveaxis(window.reshape(-1, *[1] * (len(shape) - 1)), 0, axis)
    spacing = (CELL,) * len(shape)
    return IndexField.from_samples(
        samples, origin=origin, spacing=spacing, geometry=geometry, ambient_index=AMBIENT, interpolation=interpolation
    )


def mesh_field(geometry: str, interpolation: str) -> IndexField:
    """Return a field on a wavy structured mesh."""
    low = -9e-4 if geometry == "planar" else 0.0
    y, z = np.meshgrid(np.linspace(low, 9e-4, 19), np.linspace(0.0, 3e-3, 31), indexing="ij")
    wave = 4e-5 * np.sin(z / 3e-4) * np.sin(np.pi * (y - low) / (9e-4 - low))
    mesh = QuadMesh.structured(y + wave, z, geometry)
    return IndexField.from_mesh(mesh, noise((19, 31)), ambient_index=AMBIENT, interpolation=interpolation)


def rays(count: int, slope: float = 0.05, along_z: bool = False) -> RayBundle:
    """Return rays that start ahead of the box and enter it."""
    rng = np.random.default_rng(5)
    position = np.c_[rng.uniform(-6e-4, 6e-4, (count, 2)), np.full(count, -1e-3)]
    tilt = np.zeros((count, 2)) if along_z else rng.normal(0.0, slope, (count, 2))
    return RayBundle(position, np.c_[tilt, np.ones(count)])


def traced(field: IndexField, bundle: RayBundle, **options) -> dict[str, np.ndarray]:
    """Return every array of a trace."""
    result = ak.trace(field, bundle, **options)
    return {"status": result.status, **{name: getattr(result, name) for name in TRACED}}


def method_cases() -> Iterator[Case]:
    """Yield each geometry, interpolation and method; stop, precision and engine alternate."""
    fields = [(g, i, lambda g=g, i=i: grid_field(g, i)) for g, i in product(GRIDS, ("cubic", "linear", "monotone"))]
    meshes = product(("planar", "axisymmetric"), ("bilinear", "idw"))
    fields += [(g, i, lambda g=g, i=i: mesh_field(g, i)) for g, i in meshes]
    turns = list(product(STOPS, PRECISIONS))
    for number, ((geometry, interpolation, make), method) in enumerate(
        product(fields, ("straight", "adaptive", "fixed", "paper"))
    ):
        for engine in ENGINES:
            for turn in (0, 1) if engine == "opencl" else (number % 2,):
                stop, precision = turns[(2 * number + 3 * turn + turn) % len(turns)]
                options = {"step": 1.7e-4} if method == "fixed" else {}

                def work(make=make, method=method, engine=engine, stop=stop, precision=precision, options=options):
                    return traced(
                        make(),
                        rays(160),
                        method=method,
                        until=STOPS[stop],
                        backend=engine,
                        precision=precision,
                        **options,
                    )

                yield f"{geometry} {interpolation} {method} {stop} {engine} {precision}", work


def bundle_cases() -> Iterator[Case]:
    """Yield bundles that "auto" does not trace ray by ray."""
    for geometry, stop, precision, engine, fade in product(GRIDS, ("out", "plane"), PRECISIONS, ENGINES, (False, True)):

        def work(geometry=geometry, stop=stop, precision=precision, engine=engine, fade=fade):
            options = {"until": STOPS[stop], "backend": engine, "precision": precision}
            return traced(grid_field(geometry, fade=fade), rays(4200), **options)

        yield f"bundle {geometry} {stop} {'faded ' * fade}{engine} {precision}", work
    for precision, engine in product(PRECISIONS, ENGINES):

        def along(precision=precision, engine=engine):
            plane = Plane((0.0, 0.0, 5e-3), (0.0, 0.0, 1.0))
            field = grid_field("volume")
            return traced(field, rays(4200, along_z=True), until=plane, backend=engine, precision=precision)

        yield f"bundle along z {engine} {precision}", along


def pupil_cases() -> Iterator[Case]:
    """Yield Strehl ratios: symmetric and not, on and off the axis."""
    for geometry, place, engine, precision in product(GRIDS, ("on", "off"), ENGINES, PRECISIONS):

        def work(geometry=geometry, place=place, engine=engine, precision=precision):
            pupil = Disc(radius=4e-4, center=(0.0, 0.0 if place == "on" else 1e-4, -1e-3))
            seen = ak.estimate_strehl(
                grid_field(geometry, fade=True),
                pupil,
                ray_count=16384,
                backend=engine,
                precision=precision,
                seed=1,
                allow_truncation=True,
            )
            values = [seen.value, seen.standard_error, seen.marechal, seen.opd_rms, seen.blocked, *seen.boresight]
            return {"values": np.array(values)}

        yield f"pupil {geometry} {place} axis {engine} {precision}", work


def scene_cases() -> Iterator[Case]:
    """Yield the echo of two shipped scenes."""
    for name, engine in product(("wind-tunnel-mach3", "sea-level-mach2"), ENGINES):

        def work(name=name, engine=engine):
            scene = ak.Scene.load(name, {"trace.backend": engine})
            seen = ak.echo(scene)
            return {"time": seen.time, "power": seen.power, "voltage": seen.voltage}

        yield f"echo {name} {engine}", work


def all_cases() -> Iterator[Case]:
    """Yield every case, by name."""
    yield from method_cases()
    yield from bundle_cases()
    yield from pupil_cases()
    yield from scene_cases()


def record(path: Path, only: str) -> None:
    """Compute the cases whose names contain `only` and write their arrays."""
    arrays: dict[str, np.ndarray] = {}
    start = time.perf_counter()
    names = []
    for name, work in all_cases():
        if only and only not in name:
            continue
        names.append(name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                for key, array in work().items():
                    arrays[f"{name}|{key}"] = np.asarray(array)
            except ValueError as error:
                arrays[f"{name}|refused"] = np.array(str(error))
    np.savez_compressed(path, **arrays)
    print(f"{len(names)} cases in {time.perf_counter() - start:.0f} s, {path}")


# Numbers of steps say how a ray was traced, and step_error is an estimate by these steps.
COUNTS = ("step_count", "evaluation_count", "step_error")


def compare(before: Path, after: Path) -> int:
    """Print the rows that differ, those within the tolerance apart; return the number of those beyond it."""
    words = {"equal": 0, "within": 0, "beyond": 0}
    with np.load(before) as one, np.load(after) as other:
        keys = sorted({*one.files, *other.files})
        for case in sorted({key.split("|")[0] for key in keys}):
            level, changes = "equal", []
            for key in (key for key in keys if key.split("|")[0] == case):
                name = key.split("|")[1]
                if key not in one.files or key not in other.files:
                    level = "beyond"
                    changes.append(f"{name} only {'after' if key not in one.files else 'before'}")
                elif one[key].tobytes() != other[key].tobytes():
                    far = is_beyond(case, name, one[key], other[key])
                    level = "beyond" if far or level == "beyond" else "within"
                    changes.append(f"{name} {_difference(name, one[key], other[key])}")
            words[level] += 1
            if changes:
                print(f"{'differs' if level == 'beyond' else 'within the tolerance'}: {case}: {'; '.join(changes)}")
    print(f"{words['equal']} rows equal bit for bit, {words['within']} within the tolerance; {words['beyond']} differ")
    return words["beyond"]


def is_beyond(case: str, name: str, one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays of a case differ by more than the tolerance."""
    if one.shape != other.shape or one.dtype.kind not in "fiu" or name == "status":
        return True
    if name in COUNTS:
        return False
    tolerance = 1e-4 * WAVELENGTH if "float32" in case else 1e-15
    if case.startswith("echo"):
        tolerance = 1e-9 * float(np.abs(one).max())
    elif name == "values":  # ratios and angles of a pupil
        tolerance = 1e-4 if "float32" in case else 1e-12
    return not np.allclose(one, other, rtol=4e-16 if tolerance == 1e-15 else 0.0, atol=tolerance, equal_nan=True)


def _difference(name: str, one: np.ndarray, other: np.ndarray) -> str:
    if one.shape != other.shape or one.dtype.kind not in "fiu":
        return f"{one.shape} {one.dtype} -> {other.shape} {other.dtype}"
    known = np.isfinite(one.astype(float)) & np.isfinite(other.astype(float))
    greatest = float(np.abs(one.astype(float) - other.astype(float))[known].max(initial=0.0))
    if name in ("opd", "optical_path", "step_error"):
        return f"by up to {greatest / WAVELENGTH:.1e} wave"
    return f"by up to {greatest:.1e} in {int((one != other).sum())} of {one.size}"


def main() -> None:
    """Record or compare, as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True)
    recording = actions.add_parser("record")
    recording.add_argument("file", type=Path)
    recording.add_argument("--only", default="", help="cases whose names hold this text")
    comparing = actions.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    arguments = parser.parse_args()
    if arguments.action == "record":
        record(arguments.file, arguments.only)
    elif compare(arguments.before, arguments.after):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
