"""Compute a flow field of the wind-tunnel model, like those in aerokernels/flow/data.

    .venv/bin/python scripts/flows/make.py MACH OUT.npz [--scale 1] [--folder CASE] [--mesh-only]
        [--stagnation-pressure PA] [--stagnation-temperature K]

MACH is any number from 1.5 to 8. At 2, 3 and 4 the default stagnation conditions are the source paper's; at other Mach
numbers they are those of the nearest of the three. --scale 0.5 takes a quarter of the cells and half a minute; 1 takes
the 250 x 80 cells of the shipped fields and 4 to 8 minutes of one core. Needs OpenFOAM (made with 1912;
`apt-get install openfoam`) and this package.

Run at Mach 3 and scale 1, it gives the nodes of the shipped mach3.npz to its float32 rounding, its density to 0.23 % of
the free stream rms (5.6 % in one cell of a captured shock), and its optical path forward from the dome within 0.3 nm.
"""

import argparse
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import case
import collect
import model
import numpy as np

from aerokernels.flow import tunnel_conditions

STAGNATION_PRESSURE = {2.0: 0.19e6, 3.0: 0.36e6, 4.0: 0.63e6}
STAGNATION_TEMPERATURE = 288.0
AVERAGED_DUMPS = 6


def stages(scale: float) -> tuple[case.Stage, case.Stage]:
    """A quick start, and a slow finish with capped steps; finer meshes need more and shorter ones."""
    start, finish = round(4000 * scale), round(6000 * scale)
    return (
        case.Stage(start, start, courant=0.3, longest_step=1.0, smoothing=0.1),
        case.Stage(finish, round(500 * scale), courant=0.15, longest_step=LONGEST_STEP / scale, smoothing=0.2),
    )


# About four times the step that Courant 0.15 allows in the smallest cells at scale 1 [s].
LONGEST_STEP = 5e-8


def main() -> None:
    """Write the case, run both stages, store the averages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mach", type=float)
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--scale", type=float, default=1.0, help="cells along each direction, as a multiple of 250 x 80"
    )
    parser.add_argument("--folder", type=Path, help="keep the OpenFOAM case here")
    parser.add_argument("--mesh-only", action="store_true", help="stop after blockMesh and checkMesh; store the nodes")
    parser.add_argument("--stagnation-pressure", type=float, help="[Pa]")
    parser.add_argument("--stagnation-temperature", type=float, default=STAGNATION_TEMPERATURE, help="[K]")
    given = parser.parse_args()
    if not model.MACH_RANGE[0] <= given.mach <= model.MACH_RANGE[1]:
        parser.error(f"MACH is from {model.MACH_RANGE[0]:g} to {model.MACH_RANGE[1]:g}, got {given.mach:g}")
    if shutil.which("blockMesh") is None:
        parser.error("blockMesh is not on the path: install OpenFOAM, as with apt-get install openfoam")
    nearest = min(STAGNATION_PRESSURE, key=lambda known: abs(known - given.mach))
    pressure = given.stagnation_pressure or STAGNATION_PRESSURE[nearest]
    stream = tunnel_conditions(given.mach, pressure, given.stagnation_temperature)
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.folder or Path(scratch)
        case.write_wedge_case(folder, stream, given.scale)
        first, second = stages(given.scale)
        case.write_stage(folder, first)
        run(folder, "blockMesh")
        run(folder, "checkMesh")
        x, r = collect.read_nodes(folder, given.scale)
        arrays = {"x": x, "r": r}
        if not given.mesh_only:
            run(folder, "rhoCentralFoam", "start")
            for name in ("p", "T", "U"):  # the second stage begins where the first one ended
                shutil.copy(folder / str(first.step_count) / name, folder / "0" / name)
            shutil.rmtree(folder / str(first.step_count))
            case.write_stage(folder, second)
            run(folder, "rhoCentralFoam", "finish")
            dumps = sorted(int(path.name) for path in folder.iterdir() if path.name.isdigit() and path.name != "0")
            dumps = dumps[-AVERAGED_DUMPS:]
            arrays |= collect.read_averages(folder, dumps, given.scale) | {"dumps": np.array(dumps, float)}
        np.savez_compressed(given.out, **arrays, **free_stream(stream))


def run(folder: Path, program: str, label: str = "log") -> None:
    """Run an OpenFOAM program in the case; its output goes to a log file there."""
    log = folder / f"{program}.{label}.txt"
    environment = {"WM_PROJECT_DIR": "/usr/share/openfoam"} | dict(os.environ)  # Debian's place, which it does not set
    with log.open("w") as stream:
        done = subprocess.run([program], cwd=folder, stdout=stream, stderr=subprocess.STDOUT, env=environment)
    if done.returncode != 0:
        tail = "\n".join(log.read_text().splitlines()[-15:])
        raise SystemExit(f"{program} failed:\n{tail}")


def free_stream(stream) -> dict[str, float]:
    """The scalars stored beside the arrays."""
    return {
        "mach": stream.mach,
        "gamma": stream.gamma,
        "R": stream.gas_constant,
        "rho_inf": stream.density,
        "p_inf": stream.pressure,
        "T_inf": stream.temperature,
        "u_inf": stream.velocity,
        "T0": stream.stagnation_temperature,
        "p0": stream.stagnation_pressure,
    }


if __name__ == "__main__":
    main()
