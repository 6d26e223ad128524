"""Results are stored whole or not at all, and read back as they were."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels.jobs.store import read_result, staged_folder, write_result, write_summary


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_a_failure_leaves_nothing(tmp_path: Path, error: type[BaseException]):
    out = tmp_path / "deep" / "out"
    with pytest.raises(error), staged_folder(out) as folder:
        (folder / "a.txt").write_text("half")
        raise error
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_an_earlier_result_as_it_was(tmp_path: Path):
    out = tmp_path / "out"
    with staged_folder(out) as folder:
        (folder / "a.txt").write_text("first")
    with pytest.raises(RuntimeError), staged_folder(out) as folder:
        (folder / "a.txt").write_text("second")
        raise RuntimeError
    assert (out / "a.txt").read_text() == "first"
    assert list(tmp_path.iterdir()) == [out]


def test_a_second_run_replaces_its_own_files_only(tmp_path: Path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    (out / "a.txt").write_text("old")
    with staged_folder(out) as folder:
        (folder / "a.txt").write_text("new")
    assert {path.name: path.read_text() for path in out.iterdir()} == {"a.txt": "new", "notes.txt": "mine"}
    assert list(tmp_path.iterdir()) == [out]


def test_summary_is_strict_json(tmp_path: Path):
    write_summary(
        tmp_path / "summary.json",
        {
            "nan": np.float64("nan"),
            "inf": -np.inf,
            "pair": np.array([1.0, np.nan]),
            "count": np.int64(3),
            "path": tmp_path,
        },
    )

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    read = json.loads((tmp_path / "summary.json").read_text(), parse_constant=refuse)
    assert read == {"nan": None, "inf": None, "pair": [1.0, None], "count": 3, "path": str(tmp_path)}


def test_result_comes_back_bit_for_bit(dataset: xarray.Dataset, tmp_path: Path):
    write_result(tmp_path / "result.nc", dataset)
    xarray.testing.assert_identical(read_result(tmp_path / "result.nc"), dataset)
