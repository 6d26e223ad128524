"""What the verdict on ray optics costs beside the traced wavefront that it is given: processor time, on new fields.

Planar, axisymmetric and volume fields and meshes by both engines, and maps of 16 to 1e6 rays.
"""

import argparse
from time import process_time

import numpy as np

from aerokernels import Disc, IndexField, validity, wavefront
from aerokernels.validation.random_fields import mesh_field, uniform_field
from aerokernels.validation.wave_draws import draw_view

WAVELENGTH, PIXELS = 905e-9, (4, 16, 64, 256, 1024)


def field_of(name: str) -> tuple[IndexField, Disc, float]:
    """A new field of a name, which keeps nothing yet, its pupil and a wavelength."""
    pupil = Disc(8e-4, (0.0, 0.0, -1e-3))
    if name in ("planar", "axisymmetric", "volume"):
        return uniform_field(name, amplitude=1e-5), pupil, WAVELENGTH
    if name.startswith("mesh"):
        return mesh_field(geometry=name.split()[1]), pupil, WAVELENGTH
    view = draw_view(int(name.split()[1]))
    return view.field, view.pupil, view.wavelength


def main() -> None:
    """Print a row for each scene, then how much it is at the median and at worst."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    names = ["planar", "axisymmetric", "volume", "mesh planar", "mesh axisymmetric", "view 1000", "view 1001"]
    shares: dict[str, list[float]] = {"first": [], "again": []}
    print("| scene | engine | rays | wavefront ms | verdict ms | % | again % | by |\n" + 8 * "|---" + "|")
    for name in names:
        for engine in ("warp", "opencl"):
            for count in PIXELS:
                _times(name, engine, count)  # loads the kernels
                row = np.array([_times(name, engine, count) for _ in range(given.rounds)])
                traced, told, again, answered = np.median(row, axis=0)
                shares["first"].append(100.0 * told / traced)
                shares["again"].append(100.0 * again / traced)
                print(
                    f"| {name} | {engine} | {count**2} | {1e3 * traced:.3g} | {1e3 * told:.3g} | "
                    f"{100.0 * told / traced:.3g} | {100.0 * again / traced:.3g} | {'wave' if answered else 'rays'} |",
                    flush=True,
                )
    for kind, share in shares.items():
        below = sum(one < 5.0 for one in share)
        print(f"{kind}: median {np.median(share):.3g} %, worst {max(share):.3g} %; {below} of {len(share)} below 5 %")


def _times(name: str, engine: str, count: int) -> tuple[float, float, float, bool]:
    """Processor time of a new field's wavefront, its verdict, and that verdict again [s]; whether a wave answered."""
    field, pupil, wavelength = field_of(name)
    stops = [process_time()]
    seen = wavefront(field, pupil, wavelength=wavelength, pixel_count=count, backend=engine, allow_truncation=True)
    stops.append(process_time())
    for _ in range(2):
        told = validity(field, pupil, wavelength=wavelength, wavefront=seen)
        stops.append(process_time())
    traced, first, again = np.diff(stops)
    return float(traced), float(first), float(again), told.answered_by == "waves"


if __name__ == "__main__":
    main()
