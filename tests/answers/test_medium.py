"""Meshes that keep averages, resampled fields, levels of refinement, bodies and lookups."""

import numpy as np
import pytest

from aerokernels import Body, IndexField, QuadMesh, SolidBody
from aerokernels.medium.kept_averages import cell_deficits, cut_and_kept
from aerokernels.medium.levels import refinement
from aerokernels.medium.mesh_columns import mesh_columns
from aerokernels.medium.refined import refined
from aerokernels.medium.vertex_values import linear_values_and_smooth, values_and_smooth, vertex_gradients
from tests.medium.test_kept_averages import triangles
from tests.medium.test_row_sums import attached_shock

from .records import Nudge
from .scenes import ball, bent_mesh, nudged

STAGES = ("medium",)
COUNT = 15


def flow_averages(mesh: QuadMesh, nudge: Nudge, jump: bool) -> np.ndarray:
    """Averages of a smooth flow, or of one with a shock, over the cells of a mesh."""
    if jump:
        own = attached_shock(COUNT - 1)
        return nudge(own if mesh.parents is None else np.repeat(own, 2)[mesh.parents])
    u, v = mesh.cell_centroid.T
    smooth = 1.2 + 0.3 * np.sin(4.0 * u) * np.cos(3.0 * v)
    return nudge(
        smooth if mesh.parents is None else smooth[np.unique(mesh.parents, return_index=True)[1]][mesh.parents]
    )


@pytest.mark.parametrize("jump", [False, True])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("cut", [False, True])
def test_averages(answers, geometry: str, cut: bool, jump: bool):
    """Values at vertices, and in cut cells that keep the averages, on bent cells and on triangles cut in three."""

    def case(nudge: Nudge):
        mesh = (triangles if cut else lambda count, kind: bent_mesh(count, kind))(COUNT, geometry)
        average = flow_averages(mesh, nudge, jump)
        values, smooth = values_and_smooth(mesh, average)
        finer, kept, own = cut_and_kept(mesh, average, 0.9)
        found = values, smooth, finer.vertices, kept, own, vertex_gradients(mesh, values)
        return *found, linear_values_and_smooth(mesh, average), cell_deficits(mesh, average, values)

    answers(case)


@pytest.mark.parametrize("interpolation", ["bilinear", "cells"])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_mesh(answers, geometry: str, interpolation: str):
    """Lookups in a mesh, its columns, its finer levels, and a grid that it is resampled to."""

    def case(nudge: Nudge):
        mesh = bent_mesh(COUNT, geometry)
        contrast = nudge(1e-7 * np.cos(2.0 * mesh.vertices[:, 0]) * np.sin(3.0 * mesh.vertices[:, 1] + 0.4))
        average = nudge(1e-7 * np.cos(2.0 * mesh.cell_centroid[:, 0]))
        field = IndexField.from_mesh(
            mesh, average if interpolation == "cells" else contrast, interpolation=interpolation
        )
        rng = np.random.default_rng(6)
        points = np.c_[np.zeros(60), rng.uniform(0.0, 1.7, 60), rng.uniform(-0.1, 1.1, 60)]
        around = np.c_[points[:, 1] * np.cos(points[:, 2]), points[:, 1] * np.sin(points[:, 2]), points[:, 2]]
        where = around if geometry == "axisymmetric" else points
        direction = np.array([[0.0, 0.3, 1.0]]) / np.hypot(0.3, 1.0)
        columns = mesh_columns(mesh, average, where, np.repeat(direction, 60, axis=0))
        found = field.evaluate(where), mesh.locate(points[:, 1:]), columns, mesh.neighbors, mesh.corner_weights
        if interpolation == "cells":
            return found
        coarse = field.resample(0.08), field.resample(tolerance=0.3, wavelength=1e-6)
        finer = refined(field)
        return *found, coarse, coarse[0].resampling, refinement(field), finer, field.box, field.averages_lacking

    answers(case)


@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_grid(answers, geometry: str, interpolation: str):
    """Values, levels of refinement, resampled grids and parts."""

    def case(nudge: Nudge):
        field = nudged(ball(nudge, geometry, 1e-4), nudge).with_interpolation(interpolation)
        rng = np.random.default_rng(7)
        points = rng.uniform(-0.06, 0.08, (50, 3))
        levels = refinement(field)
        parts = [field.resample(0.007)]
        if geometry != "volume":
            parts.append(field.resample(tolerance=0.01, wavelength=1e-6, interpolation=interpolation))
        return field.evaluate(points), levels, [(one, one.resampling) for one in parts], field.samples.coefficients

    answers(case)


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
def test_cell_averages(answers, interpolation: str, even: bool):
    """Samples that are averages of cells."""

    def case(nudge: Nudge):
        y, z = np.meshgrid(np.arange(9.0), np.arange(12.0), indexing="ij")
        return IndexField.from_samples(
            nudge(1e-4 * np.cos(0.5 * y) * np.sin(0.3 * z + 0.2)),
            origin=(0.0 if even else -0.3, 0.0),
            spacing=(0.1, 0.05),
            geometry="axisymmetric" if even else "planar",
            interpolation=interpolation,
            cell_averages=True,
        )

    answers(case)


def lines(nudge: Nudge) -> tuple[np.ndarray, np.ndarray]:
    """Points about a body, and directions from them."""
    rng = np.random.default_rng(8)
    direction = rng.normal(size=(80, 3))
    return nudge(rng.uniform(-0.05, 0.05, (80, 3))), direction / np.linalg.norm(direction, axis=1)[:, None]


OUTLINE = [(0.0, -0.03), (0.01, -0.02), (0.012, 0.0), (0.02, 0.01), (0.015, 0.03), (0.0, 0.03)]


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric", "solid"])
def test_body(answers, geometry: str):
    """Crossings, distances and what is inside."""

    def case(nudge: Nudge):
        whole = [*OUTLINE[1:-1], *[(-0.5 * r, z) for r, z in OUTLINE[-2:0:-1]]]
        body = Body(
            nudge(np.array(whole if geometry == "planar" else OUTLINE)),
            "planar" if geometry == "planar" else "axisymmetric",
        )
        if geometry == "solid":
            body = SolidBody.of_revolution(body, 10)
            position, direction = lines(nudge)
            found = body.crossings(position, direction), body.contains(position), body.nearest_wall(position)
            return *found, body.signed_distance(position), body.section(), body.outlines(), body.box
        position, direction = lines(nudge)
        local = position[:, 1:] if geometry == "planar" else np.c_[np.abs(position[:, 0]), position[:, 2]]
        found = body.crossings(position, direction), body.contains(local), body.nearest_wall(local)
        return *found, body.signed_distance(local), body.walls, body.box

    answers(case)
