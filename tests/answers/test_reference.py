"""Steps, ends and walls of the reference engine, on grids and meshes with and without bodies."""

import numpy as np
import pytest

from aerokernels import ArcLength, Body, Disc, IndexField, Plane, RayBundle, SolidBody, estimate_strehl, trace
from tests.small_fields import oblique_rays, random_field

from .records import Nudge
from .scenes import ball, nudged

STAGES = ("tracing/engines/reference", "tracing/retrace", "tracing/trace", "medium/walls", "medium/crossings")
pytestmark = pytest.mark.filterwarnings("ignore")
STOPS = {
    "box": None,
    "within": Plane((0.0, 0.0, 4e-4), (0.0, 0.3, 1.0)),
    "far": Plane((0.0, 0.0, 5e-3), (0.1, 0.2, 1.0)),
    "arc": ArcLength(2e-3),
}
KINDS = [
    ("volume", "cubic"), ("planar", "linear"), ("axisymmetric", "monotone"), ("axisymmetric", "bilinear"),
    ("planar", "cells"), ("planar", "bilinear"), ("volume", "linear"), ("axisymmetric", "cubic"),
]  # fmt: skip
OPTIONS = {"backend": "reference", "precision": "float64", "wavelength": 905e-9}


@pytest.mark.parametrize(
    ("geometry", "interpolation", "stop"),
    [
        *[(*kind, stop) for kind in KINDS for stop in ("within", "far")],
        ("volume", "cubic", "arc"),
        ("planar", "bilinear", "arc"),
        ("axisymmetric", "bilinear", "box"),
    ],
)
def test_rays(answers, geometry: str, interpolation: str, stop: str):
    """Rays from before the box into it, one of them along a face."""

    def case(nudge: Nudge):
        field = nudged(random_field(geometry, "bilinear" if interpolation == "cells" else interpolation, 3), nudge)
        if interpolation == "cells":
            average = field.samples.values[field.mesh.cells].mean(axis=1)
            field = IndexField.from_mesh(field.mesh, average, interpolation="cells")
        return trace(
            field, oblique_rays(6), until=STOPS[stop], tolerance=1e-2, max_steps=300, **OPTIONS
        ).status_summary()

    answers(case)


@pytest.mark.parametrize(
    ("geometry", "method"), [("volume", "straight"), ("axisymmetric", "paper"), ("axisymmetric", "fixed")]
)
def test_method(answers, geometry: str, method: str):
    """The methods that a caller may ask for."""

    def case(nudge: Nudge):
        field = nudged(random_field(geometry, "cubic", 3), nudge)
        step = {"step": 7e-5} if method == "fixed" else {}
        return trace(field, oblique_rays(3), until=STOPS["far"], method=method, **step, **OPTIONS).status_summary()

    answers(case)


def cone(geometry: str) -> Body:
    """A body with an edge, ahead of which the air is disturbed."""
    profile = [(0.0, 0.012), (0.006, 0.03), (0.004, 0.04), (0.0, 0.04)]
    return Body(profile if geometry == "axisymmetric" else [(-r, z) for r, z in profile[1:3]] + profile[:3], geometry)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric", "volume"])
@pytest.mark.parametrize("engine", ["reference", "opencl"])
def test_body(answers, geometry: str, engine: str):
    """Rays that end at a wall, graze it, start inside, or start at it."""

    def case(nudge: Nudge):
        air = ball(nudge, geometry, 1e-4)
        body = SolidBody.of_revolution(cone("axisymmetric"), 12) if geometry == "volume" else cone(geometry)
        field = IndexField(air.samples, geometry, air.ambient_index, body)
        y = np.array([-0.02, -0.0061, -0.004, 1e-4, 0.003, 0.006, 0.012])
        rays = RayBundle(np.c_[np.full(7, 2e-4), y, np.full(7, -0.025)], np.array([[0.0, 0.02, 1.0]]))
        rays = rays.rows([0, 3, 5]) if (geometry, engine) == ("planar", "reference") else rays
        until = Plane((0.0, 0.0, 0.06), (0.0, 0.0, 1.0))
        options = {**OPTIONS, "backend": engine, "max_steps": 60, "tolerance": 0.1}
        return trace(field, rays, until=until, **options).status_summary()

    answers(case, nudge=1e-13 if engine == "reference" else 1e-9)


def test_pupil(answers):
    """A Strehl ratio with its budget."""

    def case(nudge: Nudge):
        field = nudged(random_field("planar", "linear", 3, amplitude=1e-5), nudge)
        pupil = Disc(2e-4, (0.0, 1e-4, -1e-3), (0.0, 0.05, 1.0))
        found = estimate_strehl(field, pupil, ray_count=16, allow_truncation=True, tolerance=0.1, **OPTIONS)
        return found.error, found.quantities

    answers(case)
