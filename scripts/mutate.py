"""Mutants of the numerical core: one operator, comparison, number or condition changed, and the module's tests run.

A mutant is caught where a test fails, an exception gets out, or the tests take five times as long. Drawn at random of
all that a module has; texts, annotations and messages of exceptions are left alone. The share that is caught is given
with its standard error. The sources are not touched: each mutant lives in a forked process. Needs `fork`.
"""

import argparse
import ast
import contextlib
import copy
import importlib.abc
import importlib.util
import itertools
import os
import random
import resource
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CORE = {  # module: the tests that concern it, the cheap ones first
    "tracing/between_samples.py": ("tests/tracing/test_leapfrog.py", "tests/tracing/test_unresolved.py"),
    "tracing/blocks.py": ("tests/tracing/test_support.py", "tests/tracing/test_step_bound.py"),
    "tracing/budget.py": ("tests/tracing/test_known_air.py", "tests/tracing/test_budget_coverage.py"),
    "tracing/budget_rays.py": ("tests/tracing/test_budget_rays.py",),
    "tracing/coherence.py": ("tests/tracing/test_coherence.py",),
    "tracing/collimated.py": ("tests/tracing/test_projection_between.py", "tests/tracing/test_projection_tables.py"),
    "tracing/cube_polynomials.py": ("tests/tracing/test_cube_polynomials.py",),
    "tracing/grid_tables.py": ("tests/tracing/test_grid_tables.py", "tests/tracing/test_linear_grids.py"),
    "tracing/held.py": ("tests/tracing/test_weak_fields.py", "tests/tracing/test_unresolved.py"),
    "tracing/high_pass.py": ("tests/tracing/test_ends_of_bundles.py",),
    "tracing/known_air.py": ("tests/tracing/test_known_air.py",),
    "tracing/lattice_quadrature.py": ("tests/test_strehl_lattice.py",),
    "tracing/launch.py": ("tests/tracing/test_trace_interface.py", "tests/tracing/test_leapfrog.py"),
    "tracing/leapfrog.py": ("tests/tracing/test_leapfrog.py", "tests/tracing/test_methods.py"),
    "tracing/lever_arms.py": ("tests/tracing/test_slanted_stops.py", "tests/tracing/test_ends_of_bundles.py"),
    "tracing/lines.py": ("tests/tracing/test_known_air.py",),
    "tracing/mesh_rim.py": ("tests/tracing/test_known_air.py",),
    "tracing/planning.py": ("tests/tracing/test_methods.py", "tests/tracing/test_leapfrog.py"),
    "tracing/prediction.py": ("tests/tracing/test_prediction.py",),
    "tracing/projection_splines.py": ("tests/tracing/test_projection_between.py",),
    "tracing/projection_tables.py": ("tests/tracing/test_projection_tables.py",),
    "tracing/pupil_air.py": ("tests/tracing/test_truncated_pupils.py",),
    "tracing/pupil_fit.py": ("tests/test_strehl_symmetry.py", "tests/test_strehl.py"),
    "tracing/pupil_job.py": ("tests/test_strehl_lattice.py", "tests/test_strehl.py"),
    "tracing/pupil_run.py": ("tests/test_strehl_symmetry.py", "tests/test_strehl.py"),
    "tracing/pupil_sums.py": ("tests/test_strehl_symmetry.py", "tests/test_strehl.py"),
    "tracing/radial_quadrature.py": ("tests/test_strehl_symmetry.py",),
    "tracing/result.py": ("tests/tracing/test_trace_interface.py", "tests/tracing/test_bundles.py"),
    "tracing/retrace.py": ("tests/tracing/test_ends_of_bundles.py",),
    "tracing/scheme.py": ("tests/tracing/test_kernel_sources.py", "tests/tracing/test_methods.py"),
    "tracing/step_bound.py": ("tests/tracing/test_step_bound.py",),
    "tracing/stop.py": ("tests/tracing/test_reference.py", "tests/tracing/test_status_and_body.py"),
    "tracing/straight_lines.py": ("tests/tracing/test_unresolved.py", "tests/tracing/test_methods.py"),
    "tracing/support.py": ("tests/tracing/test_support.py",),
    "tracing/tableau.py": ("tests/tracing/test_trace_interface.py", "tests/tracing/test_reference.py"),
    "tracing/tails.py": ("tests/tracing/test_known_air.py",),
    "tracing/trace.py": ("tests/tracing/test_trace_interface.py", "tests/tracing/test_methods.py"),
    "tracing/unresolved.py": ("tests/tracing/test_unresolved.py",),
    "tracing/bundle/clearance.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/delivery.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/family.py": ("tests/tracing/test_bundle_family.py", "tests/tracing/test_bundles.py"),
    "tracing/bundle/frame.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/hermite.py": ("tests/tracing/test_bundle_family.py", "tests/tracing/test_bundles.py"),
    "tracing/bundle/lattice.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/nodes.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/refine.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/roughness.py": ("tests/tracing/test_bundle_family.py", "tests/tracing/test_bundles.py"),
    "tracing/bundle/run.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/table.py": ("tests/tracing/test_bundles.py",),
    "tracing/bundle/tubes.py": ("tests/tracing/test_bundle_family.py", "tests/tracing/test_bundles.py"),
    "tracing/engines/field_data.py": ("tests/tracing/test_backends_agree.py", "tests/tracing/test_linear_grids.py"),
    "tracing/engines/reference/ends.py": ("tests/tracing/test_reference.py", "tests/tracing/test_status_and_body.py"),
    "tracing/engines/reference/flight.py": ("tests/tracing/test_reference.py",),
    "tracing/engines/reference/medium.py": ("tests/tracing/test_reference.py", "tests/tracing/test_backends_agree.py"),
    "tracing/engines/reference/mesh.py": ("tests/tracing/test_mesh_lookup.py", "tests/tracing/test_reference.py"),
    "tracing/engines/reference/pupil.py": ("tests/test_strehl_symmetry.py",),
    "tracing/engines/reference/rule.py": ("tests/tracing/test_reference.py",),
    "tracing/engines/reference/steps.py": ("tests/tracing/test_reference.py",),
    "tracing/engines/reference/walls.py": ("tests/tracing/test_status_and_body.py", "tests/tracing/test_bodies.py"),
    "medium/bilinear.py": ("tests/medium/test_mesh.py",),
    "medium/body.py": ("tests/medium/test_body.py",),
    "medium/cell_averages.py": ("tests/medium/test_cell_averages.py",),
    "medium/conserving.py": ("tests/medium/test_vertex_values.py",),
    "medium/crossings.py": ("tests/medium/test_crossings.py",),
    "medium/field.py": ("tests/medium/test_field.py", "tests/medium/test_grid.py"),
    "medium/grid.py": ("tests/medium/test_grid.py", "tests/medium/test_field.py"),
    "medium/labelled_grid.py": ("tests/medium/test_field.py", "tests/medium/test_grid.py"),
    "medium/levels.py": ("tests/medium/test_field.py", "tests/test_refused_values.py"),
    "medium/mesh.py": ("tests/medium/test_mesh.py",),
    "medium/mesh_columns.py": ("tests/flow/test_columns.py",),
    "medium/mesh_samples.py": ("tests/medium/test_mesh_samples.py",),
    "medium/refined.py": ("tests/medium/test_field.py", "tests/medium/test_resample.py"),
    "medium/resample.py": ("tests/medium/test_resample.py",),
    "medium/resample_grid.py": ("tests/medium/test_resample.py",),
    "medium/solid_body.py": ("tests/medium/test_solid_body.py",),
    "medium/spline.py": ("tests/medium/test_spline.py",),
    "medium/tensor_points.py": ("tests/test_waves.py",),
    "medium/triangle_crossings.py": ("tests/medium/test_solid_body.py",),
    "medium/vertex_values.py": ("tests/medium/test_vertex_values.py",),
    "medium/wall_tree.py": ("tests/medium/test_solid_body.py", "tests/medium/test_body.py"),
    "medium/walls.py": ("tests/medium/test_body.py", "tests/tracing/test_bodies.py"),
    "echo/chain.py": ("tests/echo/test_chain.py",),
    "checks.py": ("tests/test_refused_values.py", "tests/echo/test_radiometry.py"),
    "echo/detector.py": ("tests/echo/test_detector.py", "tests/echo/test_chain.py"),
    "echo/digitiser.py": ("tests/echo/test_chain.py",),
    "echo/echo_errors.py": ("tests/echo/test_echo_errors.py",),
    "echo/noise.py": ("tests/echo/test_chain.py",),
    "echo/paths.py": ("tests/echo/test_paths.py",),
    "echo/pulse_curve.py": ("tests/echo/test_chain.py", "tests/echo/test_ranging.py"),
    "echo/pulses.py": ("tests/echo/test_pulses.py",),
    "echo/pupil_reduction.py": ("tests/echo/test_return_paths.py",),
    "echo/radiometry.py": ("tests/echo/test_radiometry.py",),
    "echo/range_error.py": ("tests/echo/test_ranging.py", "tests/echo/test_chain.py"),
    "echo/range_walk.py": ("tests/echo/test_range_walk.py",),
    "echo/rangefinder.py": ("tests/echo/test_simulate.py",),
    "echo/ranging.py": ("tests/echo/test_ranging.py",),
    "echo/reflectors.py": ("tests/echo/test_reflectors.py",),
    "echo/return_paths.py": ("tests/echo/test_return_paths.py",),
    "echo/sampling_error.py": ("tests/echo/test_sampling.py",),
    "echo/shaped_curve.py": ("tests/echo/test_sampling.py",),
    "echo/simulate.py": ("tests/echo/test_simulate.py",),
    "echo/target_points.py": ("tests/echo/test_target_points.py",),
    "echo/vacuum.py": ("tests/echo/test_radiometry.py", "tests/echo/test_simulate.py"),
    "echo/waveform.py": ("tests/echo/test_radiometry.py", "tests/echo/test_ranging.py"),
    "wavefront/data.py": ("tests/test_wavefront.py", "tests/test_wavefront_map.py"),
    "wavefront/grid.py": ("tests/test_wavefront_map.py",),
    "wavefront/modes.py": ("tests/test_wavefront_map.py",),
    "wavefront/pixel_errors.py": ("tests/test_pixel_errors.py", "tests/test_wavefront_map.py"),
    "wavefront/pixel_weights.py": ("tests/test_pupils.py", "tests/test_wavefront_map.py"),
    "wavefront/point_spread.py": ("tests/test_wavefront.py",),
    "wavefront/polychromatic.py": ("tests/test_wavefront.py", "tests/test_wavefront_map.py"),
    "wavefront/result.py": ("tests/test_wavefront_map.py",),
    "wavefront/scattered.py": ("tests/test_scattered_samples.py", "tests/test_wavefront_map.py"),
    "wavefront/terms.py": ("tests/test_wavefront.py",),
    "wavefront/traced.py": ("tests/test_wavefront_map.py",),
    "wavefront/transfer.py": ("tests/test_wavefront_map.py",),
    "pupils/base.py": ("tests/test_pupils.py",),
    "pupils/disc.py": ("tests/test_pupils.py",),
    "pupils/pixels.py": ("tests/test_pupils.py",),
    "pupils/polygon.py": ("tests/test_pupils.py",),
    "pupils/square_map.py": ("tests/test_pupils.py", "tests/tracing/test_opencl_pupil.py"),
    "pupils/vectors.py": ("tests/test_pupils.py",),
    "waves/angular_spectrum.py": ("tests/test_waves.py",),
    "waves/diffraction.py": ("tests/test_verdict.py", "tests/test_waves.py"),
    "waves/layers.py": ("tests/test_waves.py", "tests/test_verdict.py"),
    "waves/screens.py": ("tests/test_verdict.py", "tests/test_waves.py"),
    "waves/shadows.py": ("tests/test_verdict.py",),
    "waves/slabs.py": ("tests/test_waves.py", "tests/test_verdict.py"),
    "waves/split_step.py": ("tests/test_waves.py", "tests/test_verdict.py"),
    "waves/validity.py": ("tests/test_verdict.py",),
    "waves/wave.py": ("tests/test_waves.py",),
    "series/bending.py": ("tests/series/test_line_integrals.py", "tests/series/test_optical_series.py"),
    "series/line_integrals.py": ("tests/series/test_line_integrals.py",),
    "series/linking.py": ("tests/series/test_statistics.py",),
    "series/look.py": ("tests/series/test_look_map.py",),
    "series/look_batch.py": ("tests/series/test_look_map.py",),
    "series/mesh_integrals.py": ("tests/series/test_line_integrals.py",),
    "series/modes.py": ("tests/series/test_statistics.py",),
    "series/plane_values.py": ("tests/series/test_line_integrals.py",),
    "series/pupil_grid.py": ("tests/series/test_optical_series.py",),
    "series/sheared_lattice.py": ("tests/series/test_line_integrals.py",),
    "series/sheared_products.py": ("tests/series/test_line_integrals.py",),
    "series/snapshot.py": ("tests/series/test_line_integrals.py", "tests/series/test_optical_series.py"),
    "series/spectra.py": ("tests/series/test_statistics.py",),
    "series/statistic_parts.py": ("tests/series/test_statistics.py",),
    "series/time_statistics.py": ("tests/series/test_statistics.py",),
    "series/uncertainty.py": ("tests/series/test_statistics.py",),
    "imaging/bos.py": ("tests/test_imaging.py",),
    "imaging/camera.py": ("tests/test_imaging.py",),
    "imaging/displacement_error.py": ("tests/test_imaging.py",),
    "imaging/dots.py": ("tests/test_imaging.py", "tests/test_refused_optics.py"),
    "imaging/landing.py": ("tests/test_imaging.py",),
    "imaging/render.py": ("tests/test_imaging.py",),
    "imaging/shift.py": ("tests/test_imaging.py",),
    "imaging/spreads.py": ("tests/test_imaging.py",),
    "imaging/through.py": ("tests/test_imaging.py",),
    "schlieren/bench.py": ("tests/schlieren/test_bench.py",),
    "schlieren/fringes.py": ("tests/schlieren/test_interferogram.py",),
    "schlieren/fronts.py": ("tests/schlieren/test_fronts.py",),
    "schlieren/knife_edge.py": ("tests/schlieren/test_knife_edge.py",),
    "schlieren/line_of_sight.py": ("tests/schlieren/test_knife_edge.py", "tests/schlieren/test_interferogram.py"),
    "schlieren/shadowgraph.py": ("tests/schlieren/test_shadowgraph.py",),
    "schlieren/shock_angle.py": ("tests/schlieren/test_fronts.py", "tests/schlieren/test_cone_shock.py"),
    "schlieren/stand_off.py": ("tests/schlieren/test_fronts.py", "tests/schlieren/test_shipped_pictures.py"),
    "schlieren/window.py": ("tests/schlieren/test_bench.py", "tests/schlieren/test_knife_edge.py"),
    "fldi/instrument.py": ("tests/test_fldi.py",),
    "fldi/known_beams.py": ("tests/test_fldi.py",),
    "fldi/rays.py": ("tests/test_fldi.py",),
    "fldi/response.py": ("tests/test_fldi.py",),
    "flow/billig.py": ("tests/flow/test_blunt_body.py",),
    "flow/blunt_body.py": ("tests/flow/test_blunt_body.py",),
    "flow/ciddor.py": ("tests/flow/test_ciddor.py",),
    "flow/conical_averages.py": ("tests/flow/test_conical_field.py", "tests/flow/test_line_integrals.py"),
    "flow/conical_field.py": ("tests/flow/test_conical_field.py", "tests/flow/test_cone.py"),
    "flow/conical_profile.py": ("tests/flow/test_conical_field.py", "tests/flow/test_cone.py"),
    "flow/exact_averages.py": ("tests/flow/test_wedge.py", "tests/flow/test_line_integrals.py"),
    "flow/exact_field.py": ("tests/flow/test_wedge.py", "tests/flow/test_expansion.py"),
    "flow/fan_field.py": ("tests/flow/test_expansion.py",),
    "flow/gas.py": ("tests/flow/test_gas.py",),
    "flow/models.py": ("tests/flow/test_models.py",),
    "flow/refractivity.py": ("tests/flow/test_refractivity.py",),
    "flow/riemann.py": ("tests/flow/test_shock_tube.py",),
    "flow/shock_tube.py": ("tests/flow/test_shock_tube.py",),
    "flow/shocks.py": ("tests/flow/test_shocks.py",),
    "flow/species.py": ("tests/flow/test_species.py",),
    "flow/taylor_maccoll.py": ("tests/flow/test_cone.py",),
    "flow/vortex.py": ("tests/flow/test_vortex.py",),
    "flow/wedge_field.py": ("tests/flow/test_wedge.py",),
    "compare.py": ("tests/test_compare.py",),
    "rays.py": ("tests/test_rays.py",),
    "sensor.py": ("tests/test_imaging.py",),
    "sobol.py": ("tests/test_sobol.py",),
    "strehl.py": ("tests/test_strehl_errors.py", "tests/test_strehl.py"),
    "strehl_budget.py": ("tests/test_strehl_errors.py", "tests/test_strehl.py"),
    "strehl_errors.py": ("tests/test_strehl_errors.py",),
    "strehl_estimate.py": ("tests/test_strehl.py",),
    "strehl_sums.py": ("tests/test_strehl_symmetry.py", "tests/test_strehl.py"),
    "zernike.py": ("tests/test_zernike.py",),
}
OTHER: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Div, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.MatMult: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.Lt: ast.LtE,
    ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot,
    ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.UAdd: ast.USub,
    ast.USub: ast.UAdd,
}  # fmt: skip
TURNED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}


def changes(tree: ast.Module) -> list[tuple[int, str, Callable[[], ast.Module]]]:
    """Every mutant of a module: line, what is changed, and what makes its tree."""
    found: list[tuple[int, str, Callable[[], ast.Module]]] = []
    left_alone: set[int] = set()
    for node in ast.walk(tree):
        hidden: list[ast.AST | None] = []
        if isinstance(node, ast.Raise):
            hidden = [node]
        elif isinstance(node, ast.FunctionDef):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            hidden = [node.returns, *(one.annotation for one in arguments), *node.decorator_list]
            hidden += [node] if node.name in ("__repr__", "_repr_html_", "plot") else []
        elif isinstance(node, ast.ClassDef):  # what a dataclass refuses is no answer
            hidden = [*node.decorator_list]
        elif isinstance(node, ast.AnnAssign):
            hidden = [node.annotation]
        elif isinstance(node, (ast.JoinedStr, ast.If)) and "TYPE_CHECKING" in ast.dump(node):
            hidden = [node]
        elif isinstance(node, ast.JoinedStr):
            hidden = [node]
        for one in hidden:
            left_alone |= {id(inner) for inner in ast.walk(one)} if one is not None else set()
    for number, node in enumerate(ast.walk(tree)):
        if id(node) in left_alone:
            continue
        for told, change in _of(node):
            found.append((getattr(node, "lineno", 0), told, partial(_mutant, tree, number, change)))
    return found


def _mutant(tree: ast.Module, number: int, change: Callable[[ast.AST], None]) -> ast.Module:
    mutant = copy.deepcopy(tree)
    change(next(inner for k, inner in enumerate(ast.walk(mutant)) if k == number))
    return mutant


def _of(node: ast.AST):
    def swapped(field: str, kind: type, at: int | None = None):
        def change(inner) -> None:
            if at is None:
                setattr(inner, field, kind())
            else:
                getattr(inner, field)[at] = kind()

        return change

    def number(value: float):
        return lambda inner: setattr(inner, "value", value)

    if isinstance(node, (ast.BinOp, ast.AugAssign, ast.BoolOp, ast.UnaryOp)) and type(node.op) in OTHER:
        other = OTHER[type(node.op)]
        yield f"{type(node.op).__name__} -> {other.__name__}", swapped("op", other)
    elif isinstance(node, ast.Compare):
        for at, one in enumerate(node.ops):
            for table in (OTHER, TURNED):
                if type(one) in table:
                    other = table[type(one)]
                    yield f"{type(one).__name__} -> {other.__name__}", swapped("ops", other, at)
    elif isinstance(node, ast.Constant) and type(node.value) is bool:
        yield f"{node.value} -> {not node.value}", number(not node.value)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = node.value + 1 if isinstance(node.value, int) else (2.0 * node.value or 1.0)
        yield f"{node.value} -> {value}", number(value)
    elif isinstance(node, (ast.If, ast.IfExp, ast.While)):
        yield "condition -> not", lambda inner: setattr(inner, "test", ast.UnaryOp(ast.Not(), inner.test))


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives the mutant in place of its module."""

    def __init__(self, name: str, path: Path, tree: ast.Module | None):
        self.name, self.path, self.tree = name, path, tree

    def find_spec(self, name, path=None, target=None):
        """Only the one module."""
        return importlib.util.spec_from_loader(name, self, origin=str(self.path)) if name == self.name else None

    def exec_module(self, module) -> None:
        """Run the mutant."""
        module.__file__ = str(self.path)
        tree = self.tree if self.tree is not None else ast.parse(self.path.read_text(encoding="utf-8"))
        exec(compile(ast.fix_missing_locations(tree), str(self.path), "exec"), module.__dict__)


def survives(module: str, tree: ast.Module | None, seconds: float) -> bool:
    """Whether the module's tests pass with that tree in its place, within so many seconds of computing."""
    child = os.fork()
    if not child:
        status = 1
        with contextlib.suppress(BaseException):
            hush = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(hush, stream)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            name = "aerokernels." + module.removesuffix(".py").replace("/", ".")
            sys.meta_path.insert(0, _Mutated(name, ROOT / "aerokernels" / module, tree))
            import pytest

            places = [str(ROOT / one) for one in CORE[module]]
            status = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *places]))
        os._exit(min(status, 100))
    end = time.monotonic() + 10.0 * seconds + 60.0
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status == 0
        if time.monotonic() > end:
            os.kill(child, 9)
        time.sleep(0.02)


def rate(modules: list[str], caught: dict[str, int], tried: dict[str, int], sizes: dict[str, int]) -> str:
    """The share that is caught: of those drawn, with its standard error, and each module by its number of mutants."""
    modules = [module for module in modules if tried[module]]
    good, total = sum(caught[module] for module in modules), sum(tried[module] for module in modules)
    share = good / max(total, 1)
    error = (share * (1.0 - share) / max(total, 1)) ** 0.5
    whole = sum(sizes[module] for module in modules)
    weighted = sum(sizes[module] / whole * caught[module] / tried[module] for module in modules)
    return (
        f"{good} of {total} caught, {100 * share:.1f} +- {100 * error:.1f} %; "
        f"{100 * weighted:.1f} % where modules count by their {whole} mutants"
    )


def main() -> int:
    """Draw mutants, of each module in turn or of all together, until the count or the time is reached."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=f"of {', '.join(CORE)}; all of them")
    parser.add_argument("--count", type=int, default=40, help="mutants of each module")
    parser.add_argument("--total", type=int, help="instead: so many of all their mutants, each as likely as another")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further mutant after this long")
    given = parser.parse_args()
    if unknown := set(given.modules) - set(CORE):
        parser.error(f"no module {', '.join(sorted(unknown))}: choose of {', '.join(CORE)}")
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    import hypothesis.internal.conjecture.engine  # noqa: F401 - what tests import is there when a process forks
    import numpy  # noqa: F401
    import pytest  # noqa: F401
    import scipy.interpolate
    import scipy.optimize
    import scipy.signal
    import scipy.special  # noqa: F401

    with contextlib.suppress(ImportError):
        import warp  # noqa: F401 - imported, and not begun: that is the child's
        import xarray  # noqa: F401

    draw, end = random.Random(given.seed), time.monotonic() + 60.0 * given.minutes
    chosen, limits = given.modules or list(CORE), {}
    every = {module: changes(ast.parse((ROOT / "aerokernels" / module).read_text("utf-8"))) for module in chosen}
    sizes = {module: len(found) for module, found in every.items()}
    if given.total is None:
        parts = [[(module, one) for one in draw.sample(found, min(given.count, len(found)))]
                 for module, found in every.items()]  # fmt: skip
        waiting = [one for turn in itertools.zip_longest(*parts) for one in turn if one is not None]
    else:
        pool = [(module, one) for module, found in every.items() for one in found]
        waiting = draw.sample(pool, min(given.total, len(pool)))
    tried, caught = dict.fromkeys(chosen, 0), dict.fromkeys(chosen, 0)
    for module, (line, told, make) in waiting:
        if time.monotonic() > end:
            break
        if module not in limits:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            if not survives(module, None, 300.0):
                parser.error(f"the tests of {module} fail without a mutant")
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            limits[module] = 5.0 * took + 2.0
            print(f"{module}: {sizes[module]} mutants, tests take {took:.1f} s", flush=True)
        alive = survives(module, make(), limits[module])
        tried[module] += 1
        caught[module] += not alive
        if alive:
            print(f"  survives: {module}:{line}: {told}", flush=True)
    chosen = [module for module in chosen if tried[module]]
    for module in chosen:
        print(f"{module}: {caught[module]} of {tried[module]} caught")
    for stage in sorted({module.split("/")[0] for module in chosen}):
        print(f"{stage}: {rate([one for one in chosen if one.split('/')[0] == stage], caught, tried, sizes)}")
    print(f"all: {rate(chosen, caught, tried, sizes)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
