"""Time a prepared Strehl ratio for new values on a known grid, beside one that is prepared again.

The field is the cone scene of `aerokernels bench bundles` (65 x 65 x 257 nodes), seen through a slanted disc, with a
slightly different contrast each time. "Field" makes an IndexField from an array, "known" is `prepared.with_field`,
"anew" `prepare_strehl`, "ratio" the first call after that, "new seed" a further one. Wall and processor time [ms],
medians.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from aerokernels import Disc, IndexField, prepare_strehl
from aerokernels.benchmark.bundle_scenes import APERTURE, CONE_HALF, SLOPE, WAVELENGTH
from aerokernels.validation.cone import cone_field
from aerokernels.validation.report import markdown_table

STEPS = ("field", "known", "anew", "ratio", "new seed")


def timed(work: Callable[[], Any], spent: list[tuple[float, float]]) -> Any:
    """Return the result of `work`, and add its wall and processor time [ms] to `spent`."""
    wall, processor = time.perf_counter(), time.process_time()
    found = work()
    spent.append((1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processor)))
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--device", default=None)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument(
        "--there", metavar="DEVICE", help="give the values as an array on this device of Warp's: cuda:0"
    )
    given = parser.parse_args()
    grid = cone_field().samples
    pupil = Disc(APERTURE, -CONE_HALF[2] * SLOPE / SLOPE[2], SLOPE)
    choices = {"wavelength": WAVELENGTH, "backend": given.backend, "device": given.device}

    def values(number: int) -> Any:
        made = (1.0 + 0.01 * number) * grid.samples
        if not given.there:
            return made
        import warp

        return warp.array(made, device=given.there)

    def field(values: Any) -> IndexField:
        place = {"origin": grid.origin, "spacing": grid.spacing, "geometry": "volume"}
        return IndexField.from_samples(values, **place, ambient_index=grid.ambient_index)

    known = prepare_strehl(field(values(0)), pupil, **choices)
    known(0)
    known = known.with_field(field(values(1)))
    known(0)
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in STEPS}
    for number in range(2, 2 + given.repeats):
        contrast = values(number)
        made = timed(lambda contrast=contrast: field(contrast), spent["field"])
        seen = timed(lambda made=made: known.with_field(made), spent["known"])
        first = timed(lambda seen=seen: seen(1), spent["ratio"])
        timed(lambda seen=seen: seen(2), spent["new seed"])
        other = field(contrast)
        anew = timed(lambda other=other: prepare_strehl(other, pupil, **choices), spent["anew"])(1)
        assert abs(first.value - anew.value) < 1e-4, (first.value, anew.value)
    plan = known.plan
    print(f"{plan.backend}, {plan.device}, {given.repeats} fields, {plan.sample_count} samples\n")
    cells = {name: np.median(np.array(each), axis=0) for name, each in spent.items()}
    rows = [[name, f"{wall:.3g}", f"{processor:.3g}"] for name, (wall, processor) in cells.items()]
    print(markdown_table(["step", "wall", "processor"], rows))


if __name__ == "__main__":
    main()
