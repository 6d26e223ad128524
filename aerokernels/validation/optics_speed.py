"""Measure the speed of pictures through a flow: a displacement map of 4 Mpixel, and a scene of 512 x 512 pixels.

Both look through a volume of smooth turbulence with one camera. Three calls are timed: the first call in a process,
which builds kernels or finds them built; a field of other values, whose coefficients are computed and sent to the
device; and the same field again. The times are wall time of the whole call, with results on the host.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from aerokernels.imaging import Camera, ImageThrough, background_displacement, image_through
from aerokernels.medium import IndexField
from aerokernels.process.clock import STAGES
from aerokernels.pupils import Disc

# Defaults: nodes along a side of the volume, pixels along a side of the map and of the scene, point spread functions
# along a side of the scene, their pixels, and rays across the pupil for each of them.
NODES, MAP_PIXELS, SCENE_PIXELS, SPREADS, SPREAD_PIXELS, PUPIL_PIXELS = 96, 2048, 512, 32, 32, 32
SIDE, FRONT, DEPTH, WAVELENGTH = 0.12, 0.3, 0.1, 532e-9
# Greatest contrast of the volume, and waves of the largest eddy along half a side.
CONTRAST, EDDY = 2e-6, 3.0
COLUMNS = ("what", "first call", "new field", "same field again", "asked of an H200")
CALLS = ("first", "new_field", "again")


def smooth_volume(nodes: int, seed: int) -> IndexField:
    """A volume of a few waves that fades out at its sides."""
    draw = np.random.default_rng([21, seed])
    place = np.linspace(-1.0, 1.0, nodes)
    fade = np.cos(0.5 * np.pi * place) ** 6
    total = np.zeros((nodes, nodes, nodes), dtype=np.float32)
    for _ in range(6):
        number, shift = draw.uniform(-EDDY, EDDY, 3), draw.uniform(0.0, 2.0 * np.pi, 3)
        x, y, z = (np.cos(np.pi * n * place + p) * fade for n, p in zip(number, shift, strict=True))
        total += draw.standard_normal() * (x[:, None, None] * y[None, :, None] * z).astype(np.float32)
    spacing = np.array([SIDE, SIDE, DEPTH]) / (nodes - 1)
    return IndexField.from_samples(
        CONTRAST * total / np.abs(total).max(),
        origin=(-0.5 * SIDE, -0.5 * SIDE, FRONT),
        spacing=tuple(spacing),
        geometry="volume",
    )


def measure_optics(
    options: dict[str, Any],
    *,
    nodes: int = NODES,
    map_pixels: int = MAP_PIXELS,
    scene_pixels: int = SCENE_PIXELS,
    spreads: int = SPREADS,
    longest: float = 50.0,
) -> Iterator[dict[str, Any]]:
    """Measure the pictures one after the other; each result is yielded at once.

    Args:
        options: Options of `trace`: backend, device, precision, tolerance.
        nodes: Nodes along a side of the volume.
        map_pixels: Pixels along a side of the displacement map.
        scene_pixels: Pixels along a side of the scene.
        spreads: Point spread functions along a side of the scene.
        longest: No further call is started after this time [s].

    Yields:
        "what", "pixels", and the seconds of CALLS where they were measured; for the last call also the tracing device,
        "device", the host's CPU seconds, "cpu", the seconds of tracing, "traced", and those of each stage, "stages".
    """
    begin = time.perf_counter()
    fields = [smooth_volume(nodes, seed) for seed in (0, 1)]
    # The camera sees 16 mm in the middle of the volume, through an aperture of 4 mm.
    scene = np.random.default_rng(3).random((scene_pixels, scene_pixels))
    wide, narrow = (Camera(Disc(2e-3), 0.1, 0.1 * 0.14 / count, count) for count in (map_pixels, scene_pixels))
    given = {"wavelength": WAVELENGTH, **options}
    calls: list[tuple[str, int, Callable[[IndexField], Any]]] = [
        (
            "displacement map, 1 ray a pixel",
            map_pixels,
            lambda field: background_displacement(field, wide, aperture_rays=1, **given),
        ),
        (
            f"scene with {spreads} x {spreads} spreads",
            scene_pixels,
            lambda field: image_through(
                field, scene, narrow, psf_nodes=spreads, psf_pixels=SPREAD_PIXELS, pupil_pixels=PUPIL_PIXELS, **given
            ),
        ),
        ("displacement map, 4 rays a pixel", map_pixels, lambda field: background_displacement(field, wide, **given)),
    ]
    for what, pixels, call in calls:
        found: dict[str, Any] = {"what": what, "pixels": pixels}
        for name, field in zip(CALLS, (fields[0], fields[1], fields[1]), strict=True):
            if time.perf_counter() - begin > longest:
                break
            start = time.perf_counter(), time.process_time()
            made = call(field)
            found[name], found["cpu"] = time.perf_counter() - start[0], time.process_time() - start[1]
            stages = made.seconds
            plan = (made.shift if isinstance(made, ImageThrough) else made).plan
            found["device"] = f"{plan.backend}, {plan.device}"
            found["traced"] = sum(stages.get(stage, 0.0) for stage in ("plan", "upload", "kernel", "download"))
            found["stages"] = {name: stages[name] for name in STAGES if stages.get(name)}
        yield found


def table_row(one: dict[str, Any]) -> tuple[str, ...]:
    """The texts of a row in the order of COLUMNS."""
    asked = "0.5 s" if one["what"].startswith("scene") else "1 s"
    times = [f"{one[name]:.3g} s" if name in one else "-" for name in CALLS]
    return f"{one['what']}, {one['pixels']} x {one['pixels']}", *times, asked
