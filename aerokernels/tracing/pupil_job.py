"""A pupil job: a pupil's rays planned, and made ready on the backend of the plan."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import Pupil, RayBundle
from .allowance import check_tolerance
from .lattice_quadrature import ACCEPTED, ENOUGH, LATTICES, lattice_sizes, may_still_settle
from .leapfrog import PILOT_RAYS
from .lines import box_size
from .plan import TracePlan
from .planning import plan_rays
from .pupil_air import SAMPLE_RAYS, PupilAir, pupil_air
from .pupil_run import PupilRun
from .pupil_sums import PupilTask
from .radial_quadrature import RADIAL_RAYS, SETTLED, choose_radial, fewer_rays, radial_bundle
from .stop import Plane

REPLICATES = 16
# The seed of the points by which a lattice is chosen.
PILOT_SEED = 0x1A771CE
# Plans of pupils, and what they lose where the air ends, that a field keeps: those of the last ones.
KEPT = 4  # speed only
# A pupil's reach over half of the diagonal of the field's box.
GREATEST_RATIO = 10.0
# A number of samples that is known is confirmed by one in so many of the rays by which it is sought.
CONFIRMING = 2
# Of a symmetric pupil the rays of a sample lie along a radius, so that fewer show as much: this share of them.
ALONG_RADIUS = 0.25


@dataclass(eq=False)
class PupilJob:
    """A pupil to be traced, for any number of seeds.

    Attributes:
        plan: How the rays of the first run are traced.
        plan_of: How so many rays of it are; tables are made only where they are enough to pay.
        until: Where its rays stop.
        per_replicate: Rays of a replicate that were asked for.
        task: What is traced; fewer rays where radial quadrature takes the place of the disc.
        air: What the rays may lose where the known air ends.
        pilot: Some of its rays.
        sizes: Points of the lattices that may take the place of the points of `task`, see lattice_quadrature.py.
        is_known: Whether the first of them is taken without being tried.
        is_alike: Whether it was made like a job for another field.
    """

    plan: TracePlan
    plan_of: Callable[[int], TracePlan]
    until: Plane
    per_replicate: int
    task: PupilTask
    air: PupilAir
    pilot: RayBundle
    sizes: tuple[int, ...] = ()
    is_known: bool = False
    is_alike: bool = False

    @property
    def predicted_ray_count(self) -> int:
        """Rays of the first run, before any is traced."""
        return (self.sizes[0] if self.sizes else self.task.per_replicate) * REPLICATES

    @property
    def traced_ray_count(self) -> int:
        """Rays of the first run."""
        return self.run.task.per_replicate * REPLICATES

    @property
    def is_radial(self) -> bool:
        """Whether radial quadrature takes the place of the disc: field, pupil and rays are symmetric about the axis."""
        return self.task.is_radial

    def settled(self, run: PupilRun) -> float:
        """The standard error of the Strehl ratio of a run above which the next finer one is traced."""
        if run.task.generator:
            return ACCEPTED
        return SETTLED if run.task.per_replicate >= RADIAL_RAYS else ENOUGH

    @cached_property
    def samples(self) -> tuple[RayBundle | None, RayBundle | None]:
        """The pilot, and the rays along which the ends of the air are looked at, for jobs that are like this one."""
        if self.is_alike:
            return self.pilot, self.air.rays
        if not self.is_radial:
            return self.pilot.rows(slice(None, None, CONFIRMING)), self.air.rays
        pupil, look = self.task.pupil, self.task.look
        pilot_rays, air_rays = (int(ALONG_RADIUS * count) for count in (PILOT_RAYS, SAMPLE_RAYS))
        return radial_bundle(pupil, look, pilot_rays), radial_bundle(pupil, look, air_rays)

    @cached_property
    def run(self) -> PupilRun:
        """Traces the points of a seed and sums; uploads and compiles when it is first asked for.

        It takes the smallest lattice that is enough for the points of PILOT_SEED, so that no answer depends on others.
        """
        errors: dict[int, float] = {}
        for size in self.sizes:
            if may_still_settle(errors, size):
                plan = self.plan_of(size * REPLICATES)
                tried = _runner(replace(self.task, plan=plan, per_replicate=size, generator=LATTICES[size]))
                if self.is_known:
                    return tried
                errors[size] = tried(PILOT_SEED).standard_error
                if errors[size] <= ENOUGH:
                    return tried
        return _runner(replace(self.task, plan=self.plan_of(self.task.per_replicate * REPLICATES)))

    @cached_property
    def finer_runs(self) -> list[Callable[[], PupilRun]]:
        """Those with more rays than the first, up to as many as were asked for; made when they are first called."""
        known = {RADIAL_RAYS, self.per_replicate} if self.is_radial else {self.per_replicate}
        sizes = sorted(size for size in known if self.run.task.per_replicate < size <= self.per_replicate)
        return [cache(partial(_finer_run, self.task, self.plan_of, size)) for size in sizes]

    @cached_property
    def planned(self) -> TracePlan:
        """The plan of the first run, with what its rays over the pupil were chosen by."""
        plan = self.run.task.plan
        return replace(plan, reasons=(*plan.reasons, *self._chosen))

    def planned_for(self, run: PupilRun, *more: str) -> TracePlan:
        """The plan of a run, with what the rays over the pupil were chosen by, and why there are more of them."""
        plan = run.task.plan
        return self.planned if run is self.run else replace(plan, reasons=(*plan.reasons, *self._chosen, *more))

    @property
    def _chosen(self) -> tuple[str, ...]:
        """What the rays over the pupil were chosen by, in words."""
        size = self.run.task.per_replicate if self.run.task.generator else 0
        asked = f"{self.per_replicate * REPLICATES:,} over the pupil"
        if size:
            return (f"the wavefront is smooth: {REPLICATES} x {size} points of shifted lattices instead of {asked}",)
        return (f"{asked}: the wavefront is too rough, or cut, for fewer",) if self.sizes else ()


def make_job(
    field: IndexField,
    pupil: Pupil,
    look: np.ndarray,
    wavelength: float,
    ray_count: int,
    remove,
    symmetry,
    bundle: str = "auto",
    like: PupilJob | None = None,
    **choices,
) -> PupilJob:
    """A pupil planned; `choices` are those of `make_plan`.

    `like` is a job with the same choices through a field like this one: what it found is confirmed, not sought again.

    Raises:
        ValueError: A name or number that makes no sense; symmetry=True without symmetry; no ray that meets the field.
    """
    _check_size(field, pupil)
    if like is not None:
        share_places(field, like.task.field)
    tolerance = check_tolerance(choices["tolerance"])
    pilot, air_rays = (None, None) if like is None else like.samples
    seen = (weakref.ref(pupil), tuple(look.tolist()), like is None)  # what a field keeps for the next seed
    air = field.derive(
        ("air of a pupil", *seen, tolerance * wavelength),
        lambda: pupil_air(field, pupil, look, tolerance * wavelength, air_rays),
        KEPT,
    )
    pilot = field.derive(
        ("pilot of a pupil", *seen),
        lambda: pilot or RayBundle.collimated(pupil, PILOT_RAYS, direction=look),
        KEPT,
    )
    until = plane_beyond(field, pupil, look)
    per_replicate = -(-int(ray_count) // REPLICATES)  # rounded up
    sizes = lattice_sizes(field, pupil, per_replicate, REPLICATES, bundle)
    most = RADIAL_RAYS if like is None else fewer_rays(field, pupil, REPLICATES)
    radial_rays, why = choose_radial(field, pupil, look, per_replicate, REPLICATES, symmetry, most)
    count = min(per_replicate, RADIAL_RAYS) if radial_rays else per_replicate
    is_sparse = 0 < radial_rays < RADIAL_RAYS and like is not None
    known_plan = None if like is None else like.plan  # of a job that need not live as long as this one

    def plan_of(rays: int) -> TracePlan:
        plan = field.derive(
            # A plan that was confirmed for other values is not the one sought for these: answers depend on no other
            # call.
            ("plan of a pupil", *seen, count, rays, wavelength, tuple(choices.values())),
            lambda: plan_rays(
                field,
                lambda: pilot,
                REPLICATES * count,
                until,
                path_length=None,
                wavelength=wavelength,
                directions=look[None],
                like=known_plan,
                sure_count=rays,
                **choices,
            ),
            KEPT,
        )
        return replace(plan, reasons=(*plan.reasons, why), few_rays=is_sparse)

    known = 0 if like is None or not like.run.task.generator else like.run.task.per_replicate
    is_known = known in sizes and not radial_rays
    sizes = () if radial_rays else (known,) if is_known else sizes
    first = sizes[0] if sizes else radial_rays or per_replicate
    plan = plan_of(REPLICATES * first)
    task = PupilTask(
        field,
        pupil,
        look,
        until,
        plan,
        wavelength,
        radial_rays or per_replicate,
        REPLICATES,
        # A symmetric wavefront has no tilt, and the piston changes no Strehl ratio.
        terms=tuple(term for term in remove if term == "focus" or (term == "tilt" and not radial_rays)),
        # About the axis of an axisymmetric field neighbours are rays of one radius, wherever they lie.
        by_radius=field.geometry == "axisymmetric"
        and pupil.inner_ratio is not None
        and float(np.hypot(*pupil.center[:2])) < 0.05 * pupil.reach,
        is_radial=radial_rays > 0,
    )
    return PupilJob(plan, plan_of, until, per_replicate, task, air, pilot, sizes, is_known, like is not None)


def share_places(field: IndexField, other: IndexField) -> None:
    """Let a field on a uniform grid use what was worked out of the nodes' places for another one on this grid."""
    if isinstance(field.samples, UniformGrid) and isinstance(other.samples, UniformGrid):
        field.samples.share_places(other.samples)


def _check_size(field: IndexField, pupil: Pupil) -> None:
    """Refuse a pupil so much larger than the field that hardly one ray in a hundred would meet it.

    Raises:
        ValueError: The pupil is more than ten times as large as the field.
    """
    size = 0.5 * box_size(field)
    if pupil.reach > GREATEST_RATIO * size:
        raise ValueError(
            f"the pupil's reach of {pupil.reach:g} m is {pupil.reach / size:.0f} times the field's {size:.3g} m: "
            "hardly any ray meets the field; give metres, 6e-3 for 6 mm"
        )


def _runner(task: PupilTask):
    """A task made ready on the backend of its plan."""
    if task.plan.backend == "reference":
        from .engines.reference.pupil import PupilRun as ReferencePupilRun

        return ReferencePupilRun(task)
    return PupilRun(task)


def _finer_run(task: PupilTask, plan_of: Callable[[int], TracePlan], per_replicate: int):
    """The same with so many rays of a replicate."""
    plan = replace(plan_of(per_replicate * REPLICATES), few_rays=False)
    return _runner(replace(task, plan=plan, per_replicate=per_replicate))


def plane_beyond(field: IndexField, pupil: Pupil, look: np.ndarray) -> Plane:
    """Where the rays of a pupil stop: the plane across the unit vector `look` just beyond the box and the pupil."""
    low, high = field.box
    finite = np.isfinite(low) & np.isfinite(high)
    corner = np.where(finite, np.where(look > 0.0, high, low), pupil.center)
    reach = float((corner - pupil.center) @ look)
    # A little beyond, so that the last face and the plane are never the same surface.
    return Plane(pupil.center + (max(reach, 0.0) + pupil.reach + 1e-3 * box_size(field)) * look, look)
