"""The OpenCL kernels that scripts/generate_kernels.py writes: current, and Warp's to the last bit.

Set-up: random fields in which rays bend, leave, hit a body, begin in one or miss; scenes in which every two options of
the tracer's kernel meet, traced on each engine's CPU.

Expected: equal bits. OpenCL's compiler may contract a product and a sum into one rounding, which Warp's does not on a
CPU; -DSTRICT switches that off.
"""

import itertools
import runpy
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField, QuadMesh, SolidBody
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.launch import launch
from aerokernels.tracing.plan import TracePlan
from tests.bodies import star
from tests.random_fields import CELL, noise

from ..opencl_stands import need_opencl

OUTPUTS = "opd", "position", "direction", "step_count"
STOPS = {"none": None, "plane": Plane((0.0, 0.0, 5e-3), (0.0, 0.3, 1.0)), "arc": ArcLength(4.2e-3)}
GRID = "cubic", "linear", "monotone"
OPTIONS = {
    "geometry": ("volume", "planar", "axisymmetric"),
    "interpolation": (*GRID, "bilinear", "bilinear-barron", "idw"),
    "method": ("adaptive", "straight", "fixed", "paper"),
    "stop": tuple(STOPS),
    "body": (False, True),
    "measured": (False, True),
    "precision": ("float32", "float64"),
}
Scene = tuple


def is_scene(scene: Scene) -> bool:
    """No mesh fills a volume, and error control measures its errors."""
    geometry, interpolation, method, *_, measured, _ = scene
    return not (geometry == "volume" and interpolation not in GRID) and (measured or method in ("fixed", "paper"))


def combined(scene: Scene, count: int) -> set:
    """The options of a scene, so many at a time."""
    return set(itertools.combinations(enumerate(scene), count))


def scenes(least: int) -> list[Scene]:
    """Scenes that have every pair of options that any has, and many triples; the one with the most new ones next."""
    every, found = [scene for scene in itertools.product(*OPTIONS.values()) if is_scene(scene)], []
    for count in (2, 3):
        missing = set().union(*(combined(scene, count) for scene in (*every, *found)))
        for scene in found:
            missing -= combined(scene, count)
        while missing and (count == 2 or len(found) < least):
            found.append(max(every, key=lambda scene: len(combined(scene, count) & missing)))
            missing -= combined(found[-1], count)
    return found


SCENES = scenes(30)


def body_of(geometry: str) -> Body | SolidBody:
    """A spiked body in the middle of the field; a tetrahedron in a volume."""
    if geometry == "volume":
        corners = np.array([[-4e-4, -5e-4, 1.2e-3], [6e-4, -3e-4, 1.3e-3], [1e-4, 7e-4, 1.5e-3], [0.0, 1e-4, 2.4e-3]])
        return SolidBody(corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    profile = star(np.random.default_rng(1), geometry, 6e-4).profile
    return Body(np.array([profile[:, 0], profile[:, 1] + 1.5e-3]).T, geometry)


def field_of(geometry: str, interpolation: str, has_body: bool) -> IndexField:
    """Contrasts up to 3e-4 in a box of 3 by 3 by 4 mm, on a grid or on a wavy mesh."""
    more = {"interpolation": interpolation, "body": body_of(geometry) if has_body else None}
    low = 0.0 if geometry == "axisymmetric" else -14 * CELL
    if interpolation in GRID:
        shape = (31, 29, 41) if geometry == "volume" else (29, 41)
        origin = (low,) * (len(shape) - 1) + (0.0,)
        spacing = (CELL,) * len(shape)
        return IndexField.from_samples(noise(shape, 3e-4), origin=origin, spacing=spacing, geometry=geometry, **more)
    y, z = np.meshgrid(low + CELL * np.arange(29), CELL * np.arange(41), indexing="ij")
    wave = 0.4 * CELL * np.sin(z / 3e-4) * np.sin(np.pi * (y - low) / (28 * CELL))
    return IndexField.from_mesh(QuadMesh.structured(y + wave, z, geometry), noise((29, 41), 3e-4), **more)


def rays() -> RayBundle:
    """Rays along z and aslant, from before the field, within it and beside it."""
    rng = np.random.default_rng(2)
    starts = np.column_stack([rng.uniform(-1.6e-3, 1.6e-3, (400, 2)), rng.choice([-1e-3, 1.5e-3], 400, p=[0.9, 0.1])])
    ahead = np.column_stack([rng.normal(0.0, 0.2, (400, 2)), np.ones(400)])
    ahead[::7, :2] = 0.0
    return RayBundle(starts, ahead)


@pytest.fixture(scope="module")
def device() -> Iterator[str]:
    """The CPU's OpenCL device, for which kernels are built without contraction."""
    pytest.importorskip("warp")
    name = need_opencl("cpu").info.device
    session = engine_of("opencl", name).session
    plain = session.options
    for options in ((*plain, "-DSTRICT=1"), plain):
        object.__setattr__(session, "options", options)  # a session is frozen
        session.programs.clear()
        if options != plain:
            yield name


@pytest.mark.parametrize(
    "scene",
    [pytest.param(scene, marks=[pytest.mark.slow] if number % 15 else []) for number, scene in enumerate(SCENES)],
    ids=["-".join(map(str, scene)) for scene in SCENES],
)
def test_the_tracer_gives_warps_bits(scene: Scene, device: str):
    geometry, interpolation, method, stop, has_body, measured, precision = scene
    made = []
    for backend, place in (("warp", "cpu"), ("opencl", device)):
        step = 0.7 * CELL if method == "fixed" else None
        plan = TracePlan(method, backend, place, precision, 2000, step, 1e-2)
        outputs = frozenset((*OUTPUTS, *(("step_error",) if measured else ())))
        field = field_of(geometry, interpolation, has_body)
        found = launch(field, rays(), plan, STOPS[stop], 905e-9, outputs)
        made.append({name: np.asarray(found[name]) for name in outputs | {"status"}})
    one, two = made
    assert np.mean(one["step_count"] > 5) > 0.2
    for name in one:
        np.testing.assert_array_equal(two[name], one[name], err_msg=name)


def run_script(root: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(root / "scripts" / "generate_kernels.py"), *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        timeout=600.0,
    )


def test_the_files_are_current(root: Path, tmp_path: Path):
    """Of a copy with a changed header, one that is too many and one that is missing, these are reported, no others."""
    kernels = shutil.copytree(root / "kernels", tmp_path / "kernels")
    changed = kernels / "generated" / "wall.h"
    changed.write_text(changed.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    (kernels / "generated" / "extra.h").write_text("", encoding="utf-8")
    (kernels / "trace.cl").unlink()
    done = run_script(root, "--check", "--kernels", kernels)
    told = [line.split()[0] for line in done.stdout.splitlines() if "is not current" in line]
    assert (done.returncode, told) == (1, ["generated/extra.h", "generated/wall.h", "trace.cl"]), done.stderr


REFUSED = {
    "a list": ("x = [1.0, 2.0]", 2),
    "a loop over no range": ("for k in items:\n    x = k", 2),
    "an else of a loop": ("x = y\nwhile x > y:\n    x -= y\nelse:\n    x = y", 3),
    "a value that depends on an earlier target": ("a = y\nb = y\na, b = b, a", 4),
    "an unknown function": ("x = wp.quat_identity()", 2),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_translation_is_refused_with_its_place(
    name: str, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    pytest.importorskip("warp")
    monkeypatch.syspath_prepend(str(root / "scripts"))
    from kernel_generator.scenes import Scenes
    from kernel_generator.source import Unsupported
    from kernel_generator.translator import Translator

    body, line = REFUSED[name]
    path = tmp_path / "spoilt.py"
    text = f"def spoilt(y: wp.float64):\n{textwrap.indent(body, '    ')}\n"
    path.write_text(f"import warp as wp\n\n{text}", encoding="utf-8")
    spoilt = runpy.run_path(str(path), run_name="spoilt")["spoilt"]
    translator = Translator(Scenes({"real_is_double": (0, 1)}, lambda _: True, {}), {}, set())
    with pytest.raises(Unsupported, match=rf"spoilt\.py, line {line + 2}, function spoilt"):
        translator.kernel("spoilt", {spoilt: 3})
