"""The source paper's Figure 1 on a medium whose rays are known exactly.

Medium   n^2 = n0^2 (1 - g^2 y^2), n0 = 1.5, g = 0.1 / mm, sampled on square cells of 0.25 mm
Ray      parallel to z at height x0:  y(z) = x0 cos(n0 g z / beta),  beta = n0 sqrt(1 - g^2 x0^2)
Error    |y - y_exact| / x0 on planes z = const up to 62 mm: just short of one period
Schemes  the paper's: node gradients of eq 7 interpolated on the mesh by eq 6 ("idw"), or bilinearly;
         ours: one cubic B-spline of the samples, differentiated analytically

The paper states neither its medium nor x0. x0 matters: on a row of nodes bilinear interpolation starts without an
error and is most accurate, so greatest errors are given for heights on nodes and between them.

Our spline interpolates n^2, and n^2 of this medium is a parabola, which a cubic spline represents exactly: the medium
favours us. A control medium that no polynomial fits therefore has exact rays as well (Mikaelian's lens):

Control  n = n0 sech(g y):  sinh(g y(z)) = sinh(g x0) cos(g z)
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.medium import IndexField, QuadMesh
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from tests.physics.exact_ends import parabolic_contrast, sech_contrast

from ..report import saved_figure
from .printed import FIGURE_1

AXIS_INDEX, GRADIENT = 1.5, 100.0  # n0 [1], g [1/m]
CELL, LENGTH = 0.25e-3, 62e-3  # [m]
HALF_HEIGHT, MARGIN = 4e-3, 2e-3  # of the sampled region in y, and before and behind the ray in z [m]
# Heights for which greatest errors are given, in addition to the curves' height [m]: on rows of nodes, and between
# them.
HEIGHTS = np.array([0.25, 0.4, 0.5, 0.6, 0.75, 0.85, 1.0, 1.1, 1.25, 1.35, 1.5, 1.6, 1.75, 1.85, 2.0]) * 1e-3
OFF_NODE = 1.6e-3


@dataclass(frozen=True)
class Medium:
    """A medium: contrast with the axis at heights y [m]; exact height [m] at z [m] of rays that start at x0 [m]."""

    name: str
    contrast: Callable[[np.ndarray], np.ndarray]
    exact: Callable[[np.ndarray, float], np.ndarray]


PARABOLA = Medium(
    "n² parabolic",
    lambda y: parabolic_contrast(y, AXIS_INDEX, GRADIENT),
    lambda x0, z: x0 * np.cos(GRADIENT * z / np.sqrt(1.0 - (GRADIENT * x0) ** 2)),
)
SECH = Medium(
    "n = sech",
    lambda y: sech_contrast(y, AXIS_INDEX, GRADIENT),
    lambda x0, z: np.arcsinh(np.sinh(GRADIENT * x0) * np.cos(GRADIENT * z)) / GRADIENT,
)


@dataclass(frozen=True)
class Scheme:
    """A scheme of tracing: the interpolant of the samples, the step rule, and the style of its curve."""

    name: str
    rule: str
    interpolation: str
    settings: dict[str, Any] = field(default_factory=dict)
    colour: str = "#0b6e99"
    line: str = "-"


def paper_schemes(name: str, interpolation: str, colour: str) -> list[Scheme]:
    """The paper's three step rules, in float64 so that rounding does not show."""
    rules: list[tuple[str, dict[str, Any], str]] = [
        ("fixed 0.5 mm", {"method": "fixed", "step": 0.5e-3}, ":"),
        ("fixed 0.2 mm", {"method": "fixed", "step": 0.2e-3}, "--"),
        ("eq 5", {"method": "paper"}, "-"),
    ]
    return [
        Scheme(name, rule, interpolation, {**settings, "precision": "float64"}, colour, line)
        for rule, settings, line in rules
    ]


def our_scheme(precision: str, rule: str, colour: str, line: str, **settings: Any) -> Scheme:
    """A scheme of this package, on the uniform cubic grid."""
    return Scheme(f"ours, {precision}", rule, "cubic", {**settings, "precision": precision}, colour, line)


SCHEMES = [
    *paper_schemes("paper as printed (IDW)", "idw", "#c2410c"),
    *paper_schemes("bilinear Barron gradients", "bilinear-barron", "#d99a1c"),
    our_scheme("float32", "adaptive 1e-3 waves", "#2f9e6e", "-", method="adaptive"),
    our_scheme("float32", "fixed 0.2 mm", "#2f9e6e", "--", method="fixed", step=0.2e-3),
    our_scheme("float64", "adaptive 1e-3 waves", "#0b6e99", "-.", method="adaptive"),
    our_scheme("float64", "adaptive 1e-4 waves", "#0b6e99", "-", method="adaptive", tolerance=1e-4),
    our_scheme("float64", "fixed 0.5 mm", "#0b6e99", ":", method="fixed", step=0.5e-3),
    our_scheme("float64", "fixed 0.2 mm", "#0b6e99", "--", method="fixed", step=0.2e-3),
    our_scheme("float64", "eq 5", "#7c5cbf", "-", method="paper"),
]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a scheme: errors [1], shape (plane_count, height_count); steps and evaluations of the first ray."""

    scheme: Scheme
    error: np.ndarray
    step_count: int
    evaluation_count: int


def sampled_field(medium: Medium, interpolation: str) -> IndexField:
    """A medium's samples under an interpolant; the ambient index is that of the axis, so the contrast is small."""
    y = np.arange(-round(HALF_HEIGHT / CELL), round(HALF_HEIGHT / CELL) + 1) * CELL
    z = np.arange(-round(MARGIN / CELL), round((LENGTH + MARGIN) / CELL) + 1) * CELL
    y_nodes, z_nodes = np.meshgrid(y, z, indexing="ij")
    contrast = medium.contrast(y_nodes)
    if interpolation == "cubic":
        return IndexField.from_samples(
            contrast, origin=(y[0], z[0]), spacing=(CELL, CELL), geometry="planar", ambient_index=AXIS_INDEX
        )
    mesh = QuadMesh.structured(y_nodes, z_nodes, "planar")
    return IndexField.from_mesh(mesh, contrast, ambient_index=AXIS_INDEX, interpolation=interpolation)


def run_scheme(scheme: Scheme, medium: Medium, index: IndexField, height: np.ndarray, planes: np.ndarray) -> Outcome:
    """Trace the rays to each plane separately, so that no stop changes the steps before another."""
    nought = np.zeros_like(height)
    rays = RayBundle(np.stack([nought, height, nought], axis=1), [[0.0, 0.0, 1.0]])
    error = []
    for z in planes:
        result = trace(index, rays, until=Plane([0.0, 0.0, z], [0.0, 0.0, 1.0]), **scheme.settings)
        if not result.ok.all():
            raise RuntimeError(f"{scheme.name}, {scheme.rule}: {result.status_summary()} at z = {z:g} m")
        error.append(np.abs(result.position[:, 1] - medium.exact(height, z)) / height)
    return Outcome(scheme, np.array(error), int(result.step_count[0]), int(result.evaluation_count[0]))


def run_medium(medium: Medium, height: np.ndarray, planes: np.ndarray) -> list[Outcome]:
    """All schemes in one medium."""
    fields = {name: sampled_field(medium, name) for name in ("cubic", "bilinear-barron", "idw")}
    return [run_scheme(scheme, medium, fields[scheme.interpolation], height, planes) for scheme in SCHEMES]


def draw(outcomes: list[Outcome], height: np.ndarray, planes: np.ndarray, path: Path) -> None:
    """Draw the error along z at the first height, and the greatest error against the height."""
    with saved_figure(path, 12.0, 5.6) as figure:
        along, against = figure.subplots(1, 2, sharey=True, width_ratios=(1.35, 1.0))
        order = np.argsort(height)
        for outcome in outcomes:
            scheme = outcome.scheme
            look = {"color": scheme.colour, "linestyle": scheme.line, "linewidth": 1.4}
            # The curve of a ray that crosses the exact ray would go to zero: the floor keeps it in the picture.
            along.semilogy(1e3 * planes, np.maximum(outcome.error[:, 0], 1e-14), **look)
            against.semilogy(
                1e3 * height[order],
                outcome.error.max(axis=0)[order],
                marker="o",
                markersize=2.5,
                label=f"{scheme.name}: {scheme.rule}",
                **look,
            )
        along.axhline(FIGURE_1, color="#1f2933", linewidth=0.8)
        along.annotate(
            f"the paper's greatest, {FIGURE_1}", (17.0, FIGURE_1), (0, 3), textcoords="offset points", fontsize=8.5
        )
        along.set(
            xlabel="z [mm]",
            ylabel="|y − y exact| / x₀",
            ylim=(1e-14, 3.0),
            xlim=(0.0, 1e3 * planes[-1]),
            title=f"Error along the ray, x₀ = {1e3 * height[0]:.3g} mm",
        )
        against.set(xlabel="start height x₀ [mm]", title="Greatest error (nodes are 0.25 mm apart)")
        figure.legend(*against.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8.5)
