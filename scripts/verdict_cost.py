"""Measure the processor time of the verdict on ray optics, relative to the traced wavefront that it is given.

The wavefront's time is that of a user's call on a new field: plan, upload, rays, and the map; compilation and making
the field itself do not count. "First" is the field's first verdict, "again" the same verdict repeated, "next" the
verdict beside a second wavefront of the same field, which has the plan's tables already. A fraction is the median over
the rounds; its error is half the interquartile range over the root of the number of rounds.
"""

import argparse
import gc
from time import process_time

import numpy as np

from aerokernels import Disc, IndexField, validity, wavefront
from aerokernels.validation.random_fields import mesh_field, uniform_field
from tests.draws.wave_draws import KINDS as KINDS_OF_VIEWS
from tests.draws.wave_draws import draw_view

WAVELENGTH, PIXELS = 905e-9, (4, 16, 64, 316)
SCENES = ("planar", "axisymmetric", "volume", "mesh planar", "mesh axisymmetric", "view 1000", "view 1001", "view 1002")
# Greatest number of pixels on a mesh, through which 1e5 rays take ten seconds.
MESH_PIXELS = 64
KINDS = ("first", "next", "again")


def field_of(name: str) -> tuple[IndexField, Disc, float]:
    """Return a new field of that name, with nothing cached, its pupil and a wavelength."""
    pupil = Disc(8e-4, (0.0, 0.0, -1e-3))
    if name in ("planar", "axisymmetric", "volume"):
        return uniform_field(name, amplitude=1e-5), pupil, WAVELENGTH
    if name.startswith("mesh"):
        return mesh_field(geometry=name.split()[1]), pupil, WAVELENGTH
    view = draw_view(int(name.split()[1]))
    return view.field, view.pupil, view.wavelength


def main() -> None:
    """Print a row per scene, then median and worst for each class of scene."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--engines", nargs="+", default=("warp", "opencl"))
    parser.add_argument("--pixels", nargs="+", type=int, default=PIXELS, help="of the maps along a side")
    given = parser.parse_args()
    classes: dict[tuple[str, str], list[list[float]]] = {}
    print("| scene | engine | rays | wavefront ms | verdict ms | first % | next % | again % | answered by |")
    print(9 * "|---" + "|")
    gc.disable()  # collecting other rounds' garbage must not count as the verdict's time
    for name in given.scenes:
        for engine in given.engines:
            for count in given.pixels:
                if name.startswith("mesh") and count > MESH_PIXELS:
                    continue
                _times(name, engine, count)  # loads the kernels
                gc.collect()
                rounds = [_times(name, engine, count) for _ in range(given.rounds)]
                seconds, answered = np.array([one for one, _ in rounds]), rounds[0][1]
                shares = 100.0 * seconds[:, 2:] / seconds[:, [0, 1, 0]]
                middle, error = np.median(shares, axis=0), _error(shares)
                rest = _geometry_of_view(int(name.split()[1])) if name.startswith("view") else ""
                kind = f"{rest}{name.split()[0]}"
                for group in (kind, "all"):
                    for rays in (f"{count**2} rays", "all rays"):
                        classes.setdefault((group, rays), []).append(list(middle))
                told = " | ".join(f"{one:.2g} ± {more:.1g}" for one, more in zip(middle, error, strict=True))
                traced, first = (f"{1e3 * one:.3g}" for one in np.median(seconds[:, [0, 2]], axis=0))
                print(f"| {name} | {engine} | {count**2} | {traced} | {first} | {told} | {answered} |", flush=True)
    print("\n| class | rays | rows | " + " | ".join(f"{kind}: median, worst %" for kind in KINDS) + " |")
    print(6 * "|---" + "|")
    for (group, rays), found in classes.items():
        values = np.array(found)
        ends = zip(np.median(values, axis=0), values.max(axis=0), strict=True)
        print(f"| {group} | {rays} | {len(values)} | " + " | ".join(f"{a:.2g}, {b:.2g}" for a, b in ends) + " |")


def _geometry_of_view(seed: int) -> str:
    return "planar " if KINDS_OF_VIEWS[seed % len(KINDS_OF_VIEWS)] == "shock" else "volume "


def _error(shares: np.ndarray) -> np.ndarray:
    low, high = np.percentile(shares, [25, 75], axis=0)
    return np.asarray(0.5 * (high - low) / np.sqrt(len(shares)))


def _times(name: str, engine: str, count: int) -> tuple[list[float], str]:
    """Return processor times [s] of a new field's wavefront, of the next one, of both verdicts and of one again."""
    field, pupil, wavelength = field_of(name)
    stops = [process_time()]
    answered = ""
    for _ in range(2):
        seen = wavefront(field, pupil, wavelength=wavelength, pixel_count=count, backend=engine, allow_truncation=True)
        stops.append(process_time())
        told = validity(field, pupil, wavelength=wavelength, wavefront=seen)
        answered = answered or told.answered_by
        stops.append(process_time())
    validity(field, pupil, wavelength=wavelength, wavefront=seen)
    stops.append(process_time())
    traced, first, retraced, following, again = np.diff(stops)
    return [float(one) for one in (traced, retraced, first, following, again)], answered


if __name__ == "__main__":
    main()
