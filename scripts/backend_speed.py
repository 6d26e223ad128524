"""Compare Warp with OpenCL on one machine: rays per second of the kernels, and their ratio.

Both trace the same rays through the same fields. Their launches alternate, and each pair of neighbours gives one ratio,
so that other load on the machine affects both alike. Compilation, upload and download are not counted.
"""

import argparse

import numpy as np

from aerokernels import IndexField, Plane, QuadMesh, RayBundle, trace
from aerokernels.validation.report import markdown_table

AMBIENT = 1.00027
CELL = 1e-4
KINDS = (
    ("volume", "cubic"),
    ("volume", "linear"),
    ("planar", "cubic"),
    ("axisymmetric", "cubic"),
    ("mesh", "bilinear"),
)
METHODS = ("adaptive", "fixed")
PRECISIONS = ("float32", "float64")
FAR = Plane((0.0, 0.0, 10e-3), (0.0, 0.2, 1.0))
HEADING = ["field", "interpolant", "method", "precision", "Warp [rays/s]", "OpenCL [rays/s]", "OpenCL / Warp"]


def waves(*axes: np.ndarray) -> np.ndarray:
    """Return a smooth contrast with some ten nodes per wavelength."""
    total = 3e-4 * np.ones((1,) * len(axes))
    for axis, length in zip(np.meshgrid(*axes, indexing="ij", sparse=True), (9.0, 11.0, 13.0), strict=False):
        total = total * np.sin(axis / (length * CELL))
    return total


def make_field(kind: str, interpolation: str) -> IndexField:
    """Return a field of some 3 x 3 x 4 mm."""
    across, along = np.linspace(-1.4e-3, 1.4e-3, 29), np.linspace(0.0, 4e-3, 41)
    if kind == "mesh":
        y, z = np.meshgrid(across, along, indexing="ij")
        mesh = QuadMesh.structured(y + 4e-5 * np.sin(z / 3e-4) * np.cos(y / 9e-4), z)
        return IndexField.from_mesh(mesh, waves(across, along), ambient_index=AMBIENT, interpolation=interpolation)
    axes = {"volume": (across, across, along), "planar": (across, along), "axisymmetric": (across[14:], along)}[kind]
    return IndexField.from_samples(
        waves(*axes),
        origin=[axis[0] for axis in axes],
        spacing=(CELL,) * len(axes),
        geometry=kind,
        ambient_index=AMBIENT,
        interpolation=interpolation,
    )


def make_rays(count: int) -> RayBundle:
    """Return rays that start ahead of the field and enter it, within 0.1 rad of the axis."""
    rng = np.random.default_rng(5)
    position = np.c_[rng.uniform(-0.8e-3, 0.8e-3, (count, 2)), np.full(count, -1e-3)]
    return RayBundle(position, np.c_[rng.normal(0.0, 0.05, (count, 2)), np.ones(count)])


def measure(field: IndexField, rays: RayBundle, devices: dict[str, str], repeats: int, **arguments) -> list[str]:
    """Return rays per second of both backends, and the median ratio with its standard error."""
    seconds: dict[str, list[float]] = {name: [] for name in devices}
    for trial in range(repeats + 1):
        for name, device in devices.items():
            result = trace(field, rays, until=FAR, backend=name, device=device, outputs="opd", **arguments)
            if trial:  # the first one warms up
                seconds[name].append(result.seconds["kernel"])
    warp, opencl = np.array(seconds["warp"]), np.array(seconds["opencl"])
    ratios = warp / opencl
    error = 1.2533 * ratios.std(ddof=1) / np.sqrt(len(ratios))  # of a median
    rates = [f"{rays.ray_count / np.median(times):.3g}" for times in (warp, opencl)]
    return [*rates, f"{np.median(ratios):.2f} ± {error:.2f}"]


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="scripts/backend_speed", description=__doc__.splitlines()[0])
    parser.add_argument("--rays", type=int, default=60_000, metavar="COUNT", help="rays of a launch")
    parser.add_argument("--repeats", type=int, default=9, metavar="COUNT", help="launches of each backend, at least 2")
    parser.add_argument("--warp-device", default="cpu", help="such as cpu or cuda:0")
    parser.add_argument("--opencl-device", default="cpu", help="such as cpu, gpu or a device's name")
    parser.add_argument("--fields", nargs="+", choices=[kind for kind, _ in KINDS], help="some of the fields only")
    options = parser.parse_args()
    if options.rays < 1 or options.repeats < 2:
        parser.error("give at least 1 ray and 2 repeats")
    devices = {"warp": options.warp_device, "opencl": options.opencl_device}
    rows = []
    for kind, interpolation in KINDS:
        if options.fields and kind not in options.fields:
            continue
        field = make_field(kind, interpolation)
        rays = make_rays(options.rays if kind != "mesh" else max(1, options.rays // 5))
        for method in METHODS:
            for precision in PRECISIONS:
                step = {"step": CELL} if method == "fixed" else {}
                measured = measure(field, rays, devices, options.repeats, method=method, precision=precision, **step)
                rows.append([kind, interpolation, method, precision, *measured])
                print(*rows[-1], flush=True)
    print(f"\n{markdown_table(HEADING, rows, text_columns=4)}")


if __name__ == "__main__":
    main()
