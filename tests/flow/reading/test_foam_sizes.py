"""Binary files of OpenFOAM state the sizes of their numbers, `arch "LSB;label=64;scalar=32"`, in their headers."""

from itertools import product

import numpy as np
import pytest

from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.readers.foam_file import FoamFile


def foam(path, arch: str, body: bytes, form: str = "binary"):
    path.write_bytes(f'FoamFile\n{{\n    format {form};\n    arch "{arch}";\n    class list;\n}}\n'.encode() + body)
    return FoamFile(path)


@pytest.mark.parametrize(("order", "label", "scalar"), product("<>", (32, 64), (32, 64)))
def test_numbers_have_the_sizes_that_the_header_states(tmp_path, order, label, scalar):
    labels, values = np.arange(5).astype(f"{order}i{label // 8}"), np.arange(6.0).astype(f"{order}f{scalar // 8}")
    body = b"5(" + labels.tobytes() + b")\n2(" + values.tobytes() + b")\n"
    file = foam(tmp_path / "f", f"{'LM'['<>'.index(order)]}SB;label={label};scalar={scalar}", body)
    np.testing.assert_array_equal(file.numbers(file.label), np.arange(5))
    np.testing.assert_array_equal(file.numbers(file.scalar, 3), np.arange(6.0).reshape(2, 3))


@pytest.mark.parametrize("size", ["label=0", "label=9", "scalar=16", "scalar=128"])
def test_other_sizes_are_refused(tmp_path, size):
    with pytest.raises(ReadError, match=f"states {size}: numbers have 32 or 64 bits"):
        foam(tmp_path / "f", f"LSB;{size}", b"0()")
