"""Zarr stores of strangers: codecs that would run code, and objects, are refused before Zarr opens the store."""

import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels import flow, optical_series
from aerokernels.rays import Disc

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
    "changed",
    [
        {"dtype": "|O", "filters": [{"id": "vlen-utf8"}, PICKLED]},
        {"dtype": "|O", "filters": [PICKLED]},
        {"filters": [PICKLED]},
        {"compressor": PICKLED},
        {"dtype": "|O", "filters": [{"id": "json2"}]},
        {"dtype": "|O", "filters": None},
        {"dtype": [["a", "<f8"], ["b", [["c", "|O"]]]]},
        {"filters": [{"id": "astype", "encode_dtype": "|O", "decode_dtype": "<f8"}]},
        {"filters": 5},
    ],
)
def test_a_store_that_would_run_code_is_refused_before_it_is_opened(tmp_path: Path, changed: dict):
    place = "rho" if "compressor" in changed else "time"
    evil(tmp_path / "s.zarr", tmp_path / "mark", place, **changed)
    with pytest.raises(ValueError, match=rf"s\.zarr.{place}..zarray: .*have the store written again"):
        flow.open_series(tmp_path / "s.zarr")
    assert not (tmp_path / "mark").exists()


def test_metadata_that_are_repeated_or_nested_are_checked_too(tmp_path: Path):
    """What Zarr takes in place of an array's own file: consolidated metadata of both formats; and codecs in a shard."""
    for number in (2, 3):
        store = tmp_path / f"{number}.zarr"
        dataset().to_zarr(store, zarr_format=number, consolidated=True)
        path = store / (".zmetadata" if number == 2 else "zarr.json")
        text = path.read_text()
        assert flow.open_series(store).density(1).max() == 1.25
        about = json.loads(text)
        inner = (about if number == 2 else about["consolidated_metadata"])["metadata"]
        inner["time/.zarray" if number == 2 else "time"]["filters" if number == 2 else "codecs"] = [
            {"name": "sharding_indexed", "configuration": {"codecs": [{"name": "numcodecs.pickle"}]}}
        ]
        path.write_text(json.dumps(about))
        with pytest.raises(ValueError, match="codec 'pickle' is not one of those"):
            flow.open_series(store)
    (tmp_path / "3.zarr" / "more").symlink_to(tmp_path / "2.zarr")
    path.write_text(text)
    with pytest.raises(ValueError, match="it names 'more', which is outside of its own folder"):
        flow.open_series(tmp_path / "3.zarr")


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


def test_maps_that_are_gone_on_with_are_checked_too(tmp_path: Path):
    """A run's own folder may be a stranger's as well."""
    fields = [np.full((4, 4, 4), 0.5), np.full((4, 4, 4), 0.5)]
    series = flow.open_series(fields, time_step=1e-5, geometry="volume", origin=[-0.01] * 3, spacing=[7e-3] * 3,
                              ambient_density=0.5)  # fmt: skip
    given = {"wavelength": 1e-6, "pixel_count": 4, "out": tmp_path / "maps.zarr"}
    optical_series(series, Disc(0.005), **given)
    path = tmp_path / "maps.zarr" / "strehl" / "zarr.json"
    about = json.loads(path.read_text())
    path.write_text(json.dumps({**about, "codecs": [{"name": "bytes"}, {"name": "mystery"}]}))
    with pytest.raises(ValueError, match="codec 'mystery' is not one of those"):
        optical_series(series, Disc(0.005), **given)
