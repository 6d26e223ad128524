"""Time a displacement map and a scene through a flow; see aerokernels/validation/optics_speed.py."""

import argparse
import json
import time
from pathlib import Path
from typing import Any

from aerokernels.tracing.engines.choice import choose_backend
from aerokernels.validation.optics_speed import (
    COLUMNS,
    MAP_PIXELS,
    NODES,
    SCENE_PIXELS,
    SPREADS,
    measure_optics,
    table_row,
)
from aerokernels.validation.report import markdown_table


def main() -> None:
    """Measure, and print each row when it is measured, then the table."""
    parser = argparse.ArgumentParser(prog="scripts/optics_speed", description=__doc__.splitlines()[0])
    parser.add_argument("--backend", default="auto", help="warp, opencl or auto [auto]")
    parser.add_argument("--device", help="cpu, cuda:0, or the name of an OpenCL device [the backend's own choice]")
    parser.add_argument("--tolerance", type=float, default=1e-3, help="of a ray's path [waves]")
    parser.add_argument("--longest", type=float, default=50.0, help="no call is begun after this time [s]")
    parser.add_argument("--out", type=Path, help="write what was measured to this JSON file")
    parser.add_argument("--quick", action="store_true", help="a small volume and small pictures, to see that it works")
    options = parser.parse_args()
    begin = time.perf_counter()
    choose_backend(options.backend, options.device)  # raises for a missing backend before the work
    sizes = (24, 64, 32, 3) if options.quick else (NODES, MAP_PIXELS, SCENE_PIXELS, SPREADS)
    given = {"backend": options.backend, "device": options.device, "tolerance": options.tolerance}
    found: list[dict[str, Any]] = []
    for one in measure_optics(
        given, nodes=sizes[0], map_pixels=sizes[1], scene_pixels=sizes[2], spreads=sizes[3], longest=options.longest
    ):
        found.append(one)
        traced = ""
        if "traced" in one:
            traced = "; of the last, {:.3g} s of processors, {:.3g} s of tracing; {}".format(
                one["cpu"], one["traced"], one["device"]
            )
            traced += "".join(f"\n{'':10s}{1e3 * spent:8.1f} ms {name}" for name, spent in one["stages"].items())
        print(f"{time.perf_counter() - begin:6.1f} s  {'; '.join(table_row(one))}{traced}", flush=True)
    print("\n" + markdown_table(COLUMNS, [table_row(one) for one in found]))
    if options.out is not None:
        options.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
