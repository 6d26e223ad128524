"""The fields of work-precision runs: samples, rays, and the true ends of the rays.

radial    n^2 = n0^2 (1 - g^2 r^2), n0 = 1.5, g = 0.1 / mm, r and z in cells of 0.25 mm, 62 mm; skew rays
gaussian  contrast 1e-4 exp(-r^2 / 2 s^2), s = 1 mm, a volume of 0.1 mm cells: weak, smooth, finely sampled
cone      n = 1 + 2.4e-4 (1 + 0.5 tanh((r - a tan 25 deg) / 0.5 mm)), a = y + 6 mm, r = sqrt(x^2 + z^2); a volume of
          65 x 65 x 257 nodes of 1/16 mm
shock     a plane layer at 30 degrees to the rays, contrast 1.2e-4 (1 + tanh(u / 0.075 mm)), cells of 0.1 mm: nine
          tenths of the jump happen in 2.2 cells; the rest of a box of 128 by 384 cells is uniform
mach3     the shipped field of the wind-tunnel model at Mach 3, prepared as by the scene wind-tunnel-mach3, seen
          forward through its receiver's pupil; known only by its samples

Two more for the comparison with others: the radial gradient's rays that start parallel to the axis, as in the paper's
Figure 1, and n = n0 sech(g r), of which a cubic spline represents neither n nor n^2 exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from aerokernels.benchmark.scenes import CONE_HALF, CONE_SPACING, Truth, cone_field, cone_truth, integrate, potential_of
from aerokernels.flow import shipped
from aerokernels.medium import IndexField
from aerokernels.prepare import prepare_field
from aerokernels.rays import Disc, RayBundle
from aerokernels.scene import Scene
from aerokernels.tracing import Plane
from tests.physics.exact_ends import Ends, parabolic_contrast, quadratic_ends, sech_contrast, sech_ends

LENS_INDEX, LENS_GRADIENT, LENS_CELL, LENS_LENGTH = 1.5, 100.0, 0.25e-3, 62e-3  # n0, g [1/m], [m], [m]


@dataclass(frozen=True, eq=False)
class Case:
    """A field with rays through it.

    Attributes:
        name: Name in tables.
        title: Title of figures.
        field: The field, cubic.
        cell: Node spacing along the rays [m].
        bundle: A function of the ray count that returns the rays.
        until: The plane where rays end.
        exact: A function of the rays that returns their ends in the field that was sampled; None where it is not known.
        bends: Whether rays bend so much that a straight line is not meaningful.
    """

    name: str
    title: str
    field: IndexField
    cell: float
    bundle: Callable[[int], RayBundle]
    until: Plane
    exact: Callable[[RayBundle], Truth] | None = None
    bends: bool = False


def end_plane(z: float) -> Plane:
    """The plane z = const [m]."""
    return Plane([0.0, 0.0, z], [0.0, 0.0, 1.0])


def nodes(low: float, high: float, spacing: float) -> np.ndarray:
    """Node coordinates [m]."""
    return low + spacing * np.arange(round((high - low) / spacing) + 1)


def scattered(ray_count: int, dimension: int) -> np.ndarray:
    """Scrambled Sobol points in [-1, 1], the same at every call."""
    from scipy.stats import qmc

    engine = qmc.Sobol(dimension, scramble=True, rng=np.random.default_rng(20))
    return 2.0 * engine.random_base2(int(np.ceil(np.log2(ray_count))))[:ray_count] - 1.0


def along_z(across: np.ndarray, z: float, slope: np.ndarray | None = None) -> RayBundle:
    """Rays from (x, y) on a plane z = const [m], parallel to z or with slopes (dx/dz, dy/dz)."""
    slope = np.zeros_like(across) if slope is None else slope
    return RayBundle(np.c_[across, np.full(len(across), z)], np.c_[slope, np.ones(len(across))])


def lens(contrast: np.ndarray, cell: float) -> IndexField:
    """An axisymmetric field that is constant along z, from its contrast at the nodes of r."""
    z = nodes(0.0, LENS_LENGTH, cell)
    return IndexField.from_samples(
        np.repeat(contrast[:, None], len(z), axis=1),
        origin=(0.0, 0.0),
        spacing=(cell, cell),
        geometry="axisymmetric",
        ambient_index=LENS_INDEX,
    )


def truth_of(ends: Ends, rays: RayBundle) -> Truth:
    """Exact ends on the lens's last plane, with the OPD against undisturbed rays in the index of its axis."""
    return Truth(ends.position, ends.direction, ends.opd(rays, LENS_INDEX, end_plane(LENS_LENGTH)))


def parabola_truth(rays: RayBundle) -> Truth:
    """The truth of any rays in n^2 = n0^2 (1 - g^2 r^2)."""

    def index(points):
        return LENS_INDEX * np.sqrt(1.0 - LENS_GRADIENT**2 * np.sum(points[..., :2] ** 2, axis=-1))

    sigma = (LENS_LENGTH - rays.position[:, 2]) / (index(rays.position) * rays.direction[:, 2])
    stiffness = (LENS_INDEX * LENS_GRADIENT) ** 2 * np.array([1.0, 1.0, 0.0])
    return truth_of(quadratic_ends(index, rays, sigma, stiffness=stiffness), rays)


def sech_truth(rays: RayBundle) -> Truth:
    """Truth of rays parallel to z in n = n0 sech(g r): each in its plane through the axis, where n = n0 sech(g y)."""
    radius = np.hypot(*rays.position[:, :2].T)
    outward = rays.position[:, :2] / np.where(radius > 0.0, radius, 1.0)[:, None]
    ends = sech_ends(along_z(np.c_[0.0 * radius, radius], 0.0), LENS_LENGTH, LENS_INDEX, LENS_GRADIENT)

    def turned(vectors):
        return np.c_[vectors[:, 1:2] * outward, vectors[:, 2]]

    return truth_of(Ends(turned(ends.position), turned(ends.direction), ends.optical_path, ends.arc_length), rays)


def parabolic_lens() -> IndexField:
    """n^2 = n0^2 (1 - g^2 r^2)."""
    return lens(parabolic_contrast(nodes(0.0, 4e-3, LENS_CELL), LENS_INDEX, LENS_GRADIENT), LENS_CELL)


def radial() -> Case:
    """The radial gradient, skew rays that stay within 3 mm of the axis."""

    def bundle(ray_count: int) -> RayBundle:
        place = scattered(ray_count, 4)
        return along_z(1.4e-3 * place[:, :2], 0.0, 0.1 * place[:, 2:])

    return Case(
        "radial",
        "Radial gradient, n0 = 1.5, 62 mm",
        parabolic_lens(),
        LENS_CELL,
        bundle,
        end_plane(LENS_LENGTH),
        parabola_truth,
        bends=True,
    )


def parallel_rays(ray_count: int) -> RayBundle:
    """Rays parallel to the axis, 0.5 to 2 mm off it: the heights of the paper's Figure 1."""
    share = 0.5 * (1.0 + scattered(ray_count, 2))
    radius, angle = 0.5e-3 + 1.5e-3 * share[:, 0], 2.0 * np.pi * share[:, 1]
    return along_z(radius[:, None] * np.c_[np.cos(angle), np.sin(angle)], 0.0)


def radial_parallel() -> Case:
    """The radial gradient with the rays of Figure 1."""
    return Case(
        "n² parabolic, 0.25 mm cells",
        "Radial gradient, parallel rays",
        parabolic_lens(),
        LENS_CELL,
        parallel_rays,
        end_plane(LENS_LENGTH),
        parabola_truth,
    )


def sech(cell: float) -> Case:
    """The control: as steep as the radial gradient, but no polynomial; cells of any size [m]."""
    return Case(
        f"n = sech, {1e3 * cell:g} mm cells",
        "n = n0 sech(g r), parallel rays",
        lens(sech_contrast(nodes(0.0, 4e-3, cell), LENS_INDEX, LENS_GRADIENT), cell),
        cell,
        parallel_rays,
        end_plane(LENS_LENGTH),
        sech_truth,
    )


def gaussian() -> Case:
    """The weak Gaussian blob."""
    peak, sigma, cell, half = 1e-4, 1e-3, 1e-4, 6e-3

    def formula(x, y, z):
        contrast = peak * np.exp(-(x**2 + y**2 + z**2) / (2.0 * sigma**2))
        return contrast, -np.stack([x, y]) * contrast / sigma**2

    axis = nodes(-half, half, cell)
    distance = np.meshgrid(axis, axis, axis, indexing="ij")
    contrast = peak * np.exp(-sum(a**2 for a in distance) / (2.0 * sigma**2))
    field = IndexField.from_samples(contrast, origin=(-half,) * 3, spacing=(cell,) * 3, geometry="volume")

    def bundle(ray_count: int) -> RayBundle:
        place = scattered(ray_count, 4)
        return along_z(2e-3 * place[:, :2], -half, 0.05 * place[:, 2:])

    return Case(
        "gaussian",
        "Gaussian blob, contrast 1e-4, sigma = 10 cells",
        field,
        cell,
        bundle,
        end_plane(half),
        lambda rays: integrate(potential_of(formula, 1.0), 1.0, half, 0.5 * sigma, rays),
    )


def cone() -> Case:
    """The cone scene, with rays at random."""
    return Case(
        "cone",
        "Conical layer, 0.5 mm (8 cells) thick",
        cone_field(),
        CONE_SPACING,
        lambda ray_count: along_z(1.5e-3 * scattered(ray_count, 2), -CONE_HALF[2]),
        end_plane(CONE_HALF[2]),
        cone_truth,
    )


def shock() -> Case:
    """A plane layer about two cells thick."""
    jump, thickness, cell, half, length = 2.4e-4, 0.075e-3, 1e-4, 6.4e-3, 38.4e-3
    normal_y, normal_z = -np.cos(np.radians(30.0)), np.sin(np.radians(30.0))

    def formula(x, y, z):
        u = (normal_y * y + normal_z * (z - 0.5 * length)) / thickness
        behind = expit(2.0 * u)  # (1 + tanh u) / 2
        slope = 2.0 * jump / thickness * behind * expit(-2.0 * u)
        return jump * behind, np.stack([0.0 * slope, normal_y * slope])

    y, z = np.meshgrid(nodes(-half, half, cell), nodes(0.0, length, cell), indexing="ij")
    contrast, _ = formula(0.0 * y, y, z)
    field = IndexField.from_samples(contrast, origin=(-half, 0.0), spacing=(cell, cell), geometry="planar")

    def bundle(ray_count: int) -> RayBundle:
        height = 4e-3 * scattered(ray_count, 1)
        return along_z(np.c_[0.0 * height, height], 0.0)

    return Case(
        "shock",
        "Oblique plane shock, 2.2 cells thick",
        field,
        cell,
        bundle,
        end_plane(length),
        lambda rays: integrate(potential_of(formula, 1.0), 1.0, length, 0.5 * thickness, rays),
    )


def mach3() -> Case:
    """The shipped field as the main job sees it."""
    scene = Scene.load("wind-tunnel-mach3")
    field = prepare_field(scene).field
    pupil = Disc(0.5 * scene.receiver.diameter, np.array([0.0, 0.0, scene.receiver.aperture_z]))
    return Case(
        "mach3",
        "Shipped flow at Mach 3",
        field,
        float(field.spacing[1]),
        lambda ray_count: RayBundle.collimated(pupil, ray_count, seed=20),
        end_plane(float(field.box[1][2])),
    )


def mach3_across() -> Case:
    """The shipped field as a schlieren bench sees it: rays along x beside the body, crossing its shock twice."""
    mesh_field = shipped("mach3").index_field(relation="paper")
    field = mesh_field.resample(5e-5, region=((0.0, -0.03), (0.06, 0.004)))
    reach = float(field.box[1][0])

    def bundle(ray_count: int) -> RayBundle:
        y, z = (np.array([0.021, -0.0125]) + np.array([0.007, 0.0075]) * scattered(ray_count, 2)).T
        return RayBundle(np.stack([np.full(ray_count, -reach), y, z], axis=1), [[1.0, 0.0, 0.0]])

    return Case(
        "across",
        "Shipped flow at Mach 3, across it",
        field,
        float(field.spacing[1]),
        bundle,
        Plane([reach, 0.0, 0.0], [1.0, 0.0, 0.0]),
    )


CASES: dict[str, Callable[[], Case]] = {
    "radial": radial,
    "gaussian": gaussian,
    "cone": cone,
    "shock": shock,
    "mach3": mach3,
    "across": mach3_across,
}
