"""Zarr stores of strangers: codecs that would run code are refused."""

import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels import flow

zarr = pytest.importorskip("zarr")
X = np.linspace(-0.05, 0.05, 5)
PICKLED = {"id": "pickle", "protocol": 5}


class Mark:
    """Leaves a file where it is unpickled."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        """What to call there."""
        return os.system, (f"touch '{self.path}'",)


def dataset() -> xarray.Dataset:
    rho = np.broadcast_to(np.array([1.2, 1.25])[:, None, None, None], (2, 5, 5, 5)).copy()
    data = xarray.Dataset({"rho": (("time", "x", "y", "z"), rho)}, {"time": [0.0, 1e-5], **dict.fromkeys("xyz", X)})
    return data.assign_attrs(ambient_density=1.2)


def evil(store: Path, mark: Path, place: str, **changed: object) -> None:
    """A store of format 2 whose array at `place` has other metadata, and bytes that leave a mark if unpickled."""
    dataset().to_zarr(store, zarr_format=2, consolidated=False)
    array = store / place
    about = json.loads((array / ".zarray").read_text())
    (array / ".zarray").write_text(json.dumps({**about, "compressor": None, **changed}))
    for chunk in array.iterdir():
        if chunk.name[0].isdigit():
            chunk.write_bytes(pickle.dumps(Mark(mark)))


@pytest.mark.parametrize(
    "changed", [{"dtype": "|O", "filters": [PICKLED]}, {"filters": [PICKLED]}, {"compressor": PICKLED}, {"filters": 5}]
)
def test_a_store_that_would_run_code_is_refused(tmp_path: Path, changed: dict):
    place = "rho" if "compressor" in changed else "time"
    evil(tmp_path / "s.zarr", tmp_path / "mark", place, **changed)
    with pytest.raises(ValueError, match=r"s\.zarr"):
        flow.open_series(tmp_path / "s.zarr").density(0)
    assert not (tmp_path / "mark").exists()


@pytest.mark.parametrize("number", [2, 3])
def test_numbers_and_texts_are_read_as_before(tmp_path: Path, number: int):
    """A text, a filter and another compressor, as xarray writes them in either format."""
    data = dataset().assign(case=((), np.array("a long name", dtype=object)))
    if number == 2:
        import numcodecs

        encoding = {"compressors": [numcodecs.Zlib(1)], "filters": [numcodecs.Delta("<f8"), numcodecs.Shuffle(8)]}
    else:
        encoding = {"compressors": [zarr.codecs.GzipCodec()], "chunks": (1, 4, 4, 4), "shards": (1, 8, 8, 8)}
    data.to_zarr(tmp_path / "s.zarr", zarr_format=number, encoding={"rho": encoding})
    assert flow.open_series(tmp_path / "s.zarr").density(0).max() == 1.2
