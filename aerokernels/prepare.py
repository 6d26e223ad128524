"""Prepare the index field that a scene's rays are traced through: density, index on the mesh, uniform grid.

Only the part of the flow that the scene's rays can cross is resampled: around the lines from the receiver's pupil to
the target, from the pupil's plane to the front of the computed flow. Ahead of that front is the free stream.
"""

import time
from dataclasses import dataclass

import numpy as np

from aerokernels.flow import CellDensity, ConicalFlow, DensityField, GridDensity, VertexDensity
from aerokernels.inputs.kinds import wrong_kind
from aerokernels.medium import IndexField, ResamplingError
from aerokernels.pupils import Pupil
from aerokernels.scene import Scene

Region = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Prepared:
    """The index field that a scene's rays are traced through, and how it was made."""

    density: DensityField | None  # the flow; None where the caller gave an index field
    mesh_field: IndexField  # the refractive index of the whole flow, on the flow's own mesh where it has one
    field: IndexField  # the refractive index that is traced: `mesh_field` itself (route "mesh") or its resampled part
    region: Region  # lowest and highest (r, z) or (y, z) of `field` [m]
    seconds: dict[str, float]  # time of each stage [s]

    @property
    def resampling(self) -> ResamplingError | None:
        """The measured error of resampling; None on route "mesh"."""
        return self.field.resampling if isinstance(self.field.resampling, ResamplingError) else None

    @property
    def provenance(self) -> str:
        """The origin of the flow, in words."""
        if self.density is not None:
            return self.density.provenance
        return f"index field given by the caller, {self.mesh_field.geometry}, {self.mesh_field.interpolation}"

    @property
    def front(self) -> float:
        """Highest z of the computed flow [m]; ahead of it is the free stream."""
        return float(self.mesh_field.box[1][2])


def view_radius(scene: Scene, z: float) -> float:
    """Return the greatest distance from the axis [m] at which a ray between pupil or beam exit and target crosses z."""
    pupil, edge, nearest = view_extent(scene)
    fraction = float(np.clip((z - scene.receiver.aperture_z) / max(nearest, 1e-9), 0.0, 1.0))
    return (1.0 - fraction) * pupil + fraction * max(edge, pupil)


def view_extent(scene: Scene) -> tuple[float, float, float]:
    """Return the rays' greatest off-axis distance at the pupil and at the target, and the target's least distance [m].

    Of two scenes, one has the wider view if its first two numbers are no smaller and its third is no greater.
    """
    target = scene.target
    corner, depth = float(np.hypot(0.5 * target.width, 0.5 * target.height)), float(target.corners[:, 2].max())
    if target.limits == "paper":  # eq 11 limits the sum by the beam, not by the reflector
        # Rays of the beam are aimed within this many 1/e^2 radii.
        edge = scene.beam.radius * np.array([3.0, 1.0])
        corner, normal = float(np.hypot(*edge)), np.abs(target.orientation[:, 2])
        depth = float(edge @ normal[:2] / normal[2])
    # A target point is lit from a point of the exit pupil whose off-axis distance scales as the beam's radius.
    pupil = max(scene.receiver.pupil.reach, scene.beam.exit_radius * corner / scene.beam.radius)
    return pupil, corner, target.distance - depth


def ray_region(scene: Scene, mesh_field: IndexField) -> Region:
    """Return the part of the flow that the scene's rays can cross, as lowest and highest (r, z) or (y, z) [m]."""
    low, high = (corner[1:] for corner in mesh_field.box)
    aperture = scene.receiver.aperture_z
    if aperture >= high[1]:
        raise ValueError(
            f"receiver.aperture_z = {aperture:g} m is ahead of the whole flow, which ends at {high[1]:g} m: "
            "give a place behind it, such as '-8 mm'"
        )
    # Many times the rays' displacement by refraction [m], and the range of the spline's boundary effects.
    margin = max(1e-3, 8.0 * scene.grid.spacing)
    radius, lowest = view_radius(scene, float(high[1])), aperture
    if scene.has_own_pupil:
        wider, lower = _reach_of_view(scene.view, float(low[1]), float(high[1]))
        radius, lowest = max(radius, wider), min(lowest, lower)
    radius += margin
    first = 0.0 if mesh_field.geometry == "axisymmetric" else max(-radius, float(low[0]))
    return (
        (first, max(lowest - margin, float(low[1]))),
        (min(radius, float(high[0])), float(high[1])),
    )


def _reach_of_view(pupil: Pupil, low: float, high: float) -> tuple[float, float]:
    """Return the greatest off-axis distance and the lowest z [m] of a pupil's rays for z between `low` and `high`."""
    ahead = float(pupil.normal[2])
    end = high if ahead > 0.0 else low
    length = (end - float(pupil.center[2])) / ahead if abs(ahead) > 1e-6 else np.inf
    rim = pupil.reach * float(np.sqrt(max(1.0 - ahead**2, 0.0)))  # before or behind the centre's plane
    lowest = float(pupil.center[2]) - rim if ahead > 1e-6 else -np.inf
    if not np.any(pupil.normal[:2]):
        return float(np.hypot(*pupil.center[:2])) + pupil.reach, lowest
    # Rays from the rear rim travel farthest. A path that leaves the flow sideways ends at the edge of the region.
    length = max(length, 0.0) + (rim / abs(ahead) if abs(ahead) > 1e-6 else 0.0)
    ends = (pupil.center[:2], pupil.center[:2] + (length * pupil.normal[:2] if np.isfinite(length) else np.inf))
    return max(float(np.hypot(*place)) for place in ends) + pupil.reach, lowest


def prepare_field(scene: Scene, field: IndexField | DensityField | None = None) -> Prepared:
    """Make the index field of a scene, resampled to `grid.spacing` unless `grid.route` is "mesh" or it is on a grid.

    `field` is a flow to use unchanged in place of the scene's.
    """
    if field is not None and not isinstance(field, (IndexField, DensityField)):
        raise wrong_kind(field, "field", "an IndexField or a DensityField")
    seconds = {}
    start = time.perf_counter()
    density = None if isinstance(field, IndexField) else scene.density_field() if field is None else field
    seconds["flow"] = time.perf_counter() - start

    start = time.perf_counter()
    whole = field if isinstance(field, IndexField) else flow_index(scene, density)
    whole.wavelength_for(scene.flow.wavelength)
    seconds["index"] = time.perf_counter() - start

    start = time.perf_counter()
    traced = whole
    if scene.grid.route == "uniform" and not whole.is_uniform:
        region = ray_region(scene, whole)
        try:
            traced = whole.resample(scene.grid.spacing, region=region, interpolation=scene.grid.interpolation)
        except ValueError as fault:
            raise ValueError(f"grid.spacing = {scene.grid.spacing:g} m: {fault}") from fault
    else:
        low, high = (corner[1:] for corner in whole.box)
        first = 0.0 if whole.geometry == "axisymmetric" else float(low[0])
        region = ((first, float(low[1])), (float(high[0]), float(high[1])))
    seconds["resample"] = time.perf_counter() - start
    return Prepared(density, whole, traced, region, seconds)


def flow_index(scene: Scene, density: DensityField | None) -> IndexField:
    """Return a flow's index by the scene's [flow] and [grid]: on the flow's mesh, or on a grid if it has no mesh."""
    flow, grid = scene.flow, scene.grid
    constant = flow.gladstone_dale
    if isinstance(density, (CellDensity, VertexDensity)):
        interpolation: str | None = "bilinear" if grid.route == "uniform" else grid.interpolation
        if interpolation == "bilinear" and isinstance(density, CellDensity):
            interpolation = flow.interpolation
        return density.index_field(flow.wavelength, flow.relation, constant=constant, interpolation=interpolation)
    if grid.route == "mesh":
        raise ValueError("grid.route = 'mesh' needs a flow on a mesh, and this flow has no mesh: use 'uniform'")
    if isinstance(density, GridDensity):
        return density.index_field(flow.wavelength, flow.relation, constant=constant, interpolation=grid.interpolation)
    assert isinstance(density, ConicalFlow)  # there is no other kind
    return density.index_field(
        flow.wavelength, flow.relation, constant=constant, spacing=grid.spacing, interpolation=grid.interpolation
    )
