"""ParaView's lists of files and times: read at a time, as a series, shown by `fields`, and refused where wrong."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from aerokernels import flow
from aerokernels.cli import app
from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.readers.vtk_files import collection

from . import vtk_writers, writers

pytest.importorskip("vtkmodules")
from .test_vtk_data import named

TIMES = (0.0, 2.5e-5, 1e-4)


def pvd(path, entries) -> None:
    """A collection as ParaView documents it."""
    sets = "".join("<DataSet " + " ".join(f'{k}="{v}"' for k, v in one.items()) + "/>" for one in entries)
    path.write_text(
        f'<?xml version="1.0"?><VTKFile type="Collection" version="0.1"><Collection>{sets}</Collection></VTKFile>'
    )


def written(folder, count: int = len(TIMES)) -> None:
    """Grids of densities of 1, 2, ... by VTK's own writer, in a folder of their own as ParaView puts them."""
    (folder / "data").mkdir()
    for k in range(count):
        grid = vtk_writers.vtk_grid()
        grid.GetPointData().AddArray(named(np.full(writers.NI * writers.NJ, 1.0 + k)))
        vtk_writers.write_vtk(folder / f"data/{k}.vts", grid)


def as_pvd(folder):
    pvd(folder / "a.pvd", [{"timestep": t, "part": 0, "file": f"data/{k}.vts"} for k, t in enumerate(TIMES)][::-1])
    return folder / "a.pvd"


def as_series(folder):
    files = [{"name": f"data/{k}.vts", "time": t} for k, t in enumerate(TIMES)]
    (folder / "a.vts.series").write_text(json.dumps({"file-series-version": "1.0", "files": files[::-1]}))
    return folder / "a.vts.series"


@pytest.mark.parametrize("listed", [as_pvd, as_series])
def test_times_of_a_list(tmp_path, listed):
    """Set-up: three times in either list, last first. Expected: each by its time, a series, and `fields`."""
    written(tmp_path)
    path = listed(tmp_path)
    for time, value in ((None, 3.0), ("first", 1.0), (2.5e-5, 2.0)):
        assert np.all(flow.read(path, density="rho", time=time).density == value)
    series = flow.open_series(path, density="rho")
    assert series.time.tolist() == list(TIMES)
    assert [float(one.density.mean()) for one in series] == [1.0, 2.0, 3.0]
    shown = CliRunner().invoke(app, ["fields", str(path)])
    assert shown.exit_code == 0 and "3: 0, 2.5e-05, 0.0001; shown: 0.0001" in shown.output
    with pytest.raises(ValueError, match=r"there is no time 5e-05: take one of 0, 2\.5e-05, 0\.0001"):
        flow.read(path, time=5e-5)


@pytest.mark.parametrize(
    ("entries", "told"),
    [
        ([{"timestep": 0, "file": "data/9.vts"}], r"it lists data/9\.vts, which is not there \(1 of 1 files are"),
        (
            [{"timestep": 0, "file": "../secret.vts"}],
            r"'\.\./secret\.vts', which is outside of its own .*move them together",
        ),
        ([{"timestep": 0, "file": "/etc/x.vts"}], "outside of its own folder"),
        ([{"timestep": 0, "file": ""}], "which is not a VTK file"),
        ([{"timestep": 0, "file": "data/0.vts"}] * 2, "it lists data/0.vts twice at the time 0: leave one"),
        ([{"timestep": 0, "part": 1, "file": f"data/{k}.vts"} for k in (0, 1)], "part .*1.* twice at the time 0"),
        ([{"timestep": "inf", "file": "data/0.vts"}], "data/0.vts at a time that is not a number"),
        ([], "it lists no data sets"),
    ],
)
def test_wrong_collections(tmp_path, entries, told):
    """Expected: the place and what is wrong, before a file is opened, from reading and from opening a series."""
    written(tmp_path, 2)
    pvd(tmp_path / "a.pvd", entries)
    for call in (flow.read, flow.open_series):
        with pytest.raises(ValueError, match=told) as fault:
            call(tmp_path / "a.pvd")
        assert "a.pvd" in str(fault.value)


@pytest.mark.parametrize(
    "text",
    ["", "{}", "[]", "7", "null", '{"files": 3}', '{"files": [3]}', '{"files": [{"time": 1}]}', "[" * 100_000,
     '{"files": [{"name": "data/0.vts", "time": true}]}', '{"files": [{"name": "data/0.vts", "time": "1"}]}',
     '{"files": [{"name": 1, "time": 1}]}', '{"files": [{"name": "data/0.vts"}, {"name": "data/1.vts", "time": 1}]}',
     '{"files": [{"name": "data/0.vts", "time": 1' + "0" * 400 + "}]}",
     '{"files": [{"name": "data/0.vts", "time": NaN}]}',
     '{"files": []}', '{"files": [{"name": "a\\u0000.vts", "time": 1}]}'],
)  # fmt: skip
def test_wrong_series(tmp_path, text):
    written(tmp_path, 2)
    path = tmp_path / "a.vts.series"
    path.write_text(text)
    with pytest.raises(ReadError, match=r"a\.vts\.series: "):
        collection(path)


@pytest.mark.parametrize(
    "text",
    ["", "<", "<VTKFile>", '<?xml version="1.0" encoding="none"?><a/>', '<?xml version="1.0" encoding="utf-32"?><a/>',
     "<!DOCTYPE a [<!ENTITY b 'x'>" + "".join(f"<!ENTITY {chr(99 + k)} '{f'&{chr(98 + k)};' * 50}'>" for k in range(6))
     + "]><a><DataSet file='&h;'/></a>",
     '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]><a><DataSet file="0.vts">&b;</DataSet></a>'],
)  # fmt: skip
def test_damaged_xml(tmp_path, text):
    """Expected: refused in words, entities that multiply and those of other files among them."""
    (tmp_path / "a.pvd").write_text(text)
    with pytest.raises(ReadError, match=r"not a list of data sets|lists no data sets|is not there"):
        collection(tmp_path / "a.pvd")
