"""Numbers, structs and arguments that both backends' kernels have come from one source."""

import re

from aerokernels.tracing.engines.opencl.program import HEADERS
from aerokernels.tracing.stop import RayStatus


def defined(name: str) -> dict[str, str]:
    """The macros of a header that is made from Python."""
    return dict(re.findall(r"^#define (\w+) +(\S+)", "\n".join(HEADERS[name]()), flags=re.MULTILINE))


def test_headers_hold_every_status_and_the_tableau_to_the_last_digit():
    """RKN4(3)4FM from its fractions: the numbers in the header are the float64 next to them."""
    status = defined("ray_status.h")
    assert {name: int(value) for name, value in status.items()} == {f"RAY_{s.name}": int(s) for s in RayStatus}
    constants = defined("constants.h")
    for name, value in {
        "RKN_C2": 1 / 4,
        "RKN_C3": 7 / 10,
        "RKN_A21": 1 / 32,
        "RKN_A32": 119 / 500,
        "RKN_B3": 25 / 189,
        "RKN_V4": 5 / 54,
        "RKN_E4": 1 / 20,
        "RKN_F1": 1 / 14 - 13 / 21,
    }.items():
        literal = re.fullmatch(r"R\((.*)\)", constants[name])
        assert literal is not None and abs(float(literal[1]) - value) <= 2e-16 * abs(value), name
    # A step of constant force 1 from rest: the position moves by 1/2, the momentum by 1.
    sums = {
        letter: sum(float(constants[n][2:-1]) for n in constants if n.startswith(f"RKN_{letter}")) for letter in "BV"
    }
    assert abs(sums["B"] - 0.5) < 1e-15 and abs(sums["V"] - 1.0) < 1e-15
