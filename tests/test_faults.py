"""Faults injected for real: no room on the disk, kills, two writers, a bare environment; nothing half-written stays."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels.jobs.run_folder import read_run
from aerokernels.jobs.store import staged_folder, write_summary

unix = pytest.mark.skipif(sys.platform == "win32", reason="no such signals and limits there")


def in_python(code: str, *arguments: object, options: tuple[str, ...] = (), **environment: str):
    return subprocess.run(
        [sys.executable, *options, "-c", code, *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **environment},
    )


@unix
def test_without_room_a_result_is_refused_in_words_and_leaves_nothing(tmp_path: Path):
    """A process whose files may have some bytes only, from none to most of the file: HDF5 must not end it."""
    code = (
        "import resource, sys; from pathlib import Path; import numpy as np; import xarray\n"
        "from aerokernels.jobs.store import OutputError, replace_result, staged_folder, write_result\n"
        "from aerokernels.jobs.sweeps.records import write_text\n"
        "made = xarray.Dataset({'a': ('x', np.random.default_rng(0).random(20_000), {'units': 'm'})})\n"
        "out = Path(sys.argv[1])\n"
        "def staged():\n"
        "    with staged_folder(out / 'run') as folder:\n"
        "        write_result(folder / 'result.nc', made)\n"
        "for size in (0, 900, 9_000, 120_000):\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))\n"
        "    for write in (staged, lambda: replace_result(out / 'sweep.nc', made),\n"
        "                  lambda: write_text(out / 'cases.jsonl', 'x' * 200_000)):\n"
        "        try:\n"
        "            write()\n"
        "        except OutputError as fault:\n"
        "            print(fault)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)\n"
        "print(sorted(path.name for path in out.iterdir()))\n"
        "staged()\n"
    )
    done = in_python(code, tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    *told, left = done.stdout.splitlines()
    assert len(told) == 12 and left == "[]"
    assert all(line.startswith(f"out={tmp_path}") and line.endswith("make room, or choose another place")
               for line in told)  # fmt: skip
    assert (tmp_path / "run" / "result.nc").stat().st_size > 120_000


@unix
def test_what_was_computed_is_written_elsewhere_where_the_disk_is_full(tmp_path: Path):
    """There is room again at the second attempt, in the temporary folder; then there is none there either."""
    code = (
        "import resource, sys; from pathlib import Path\n"
        "from aerokernels.jobs.store import OutputError, write_folder, write_summary\n"
        "def limit(size):\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))\n"
        "def write(folder):\n"
        "    write_summary(folder / 'summary.json', {'version': 'x' * 5_000})\n"
        "    limit(rooms.pop())\n"
        "    (folder / 'result.nc').write_bytes(bytes(20_000))\n"
        "for rooms in ([resource.RLIM_INFINITY, 6_000], [6_000, 6_000]):\n"
        "    limit(resource.RLIM_INFINITY)\n"
        "    try:\n"
        "        write_folder(Path(sys.argv[1]) / 'out', write)\n"
        "    except OutputError as fault:\n"
        "        print(fault)\n"
    )
    spare = tmp_path / "spare"
    spare.mkdir()
    done = in_python(code, tmp_path, TMPDIR=str(spare))
    assert done.returncode == 0, done.stderr[-2000:]
    kept, refused = done.stdout.splitlines()
    (only,) = spare.iterdir()  # nothing of the second attempt
    assert kept.startswith(f"out={tmp_path / 'out'}: ") and f"the results are in {only / 'out'} instead" in kept
    assert sorted(path.name for path in (only / "out").iterdir()) == ["result.nc", "summary.json"]
    assert refused.endswith("make room, or choose another place") and not (tmp_path / "out").exists()


@unix
def test_a_sweep_on_a_full_disk_keeps_what_is_done_and_goes_on(tmp_path: Path):
    """Set-up: files that may hold one case and a half, and then any number of them.

    Expected: reported with the file's name; the case that is there stays, no half of one does, and the rest is added.
    """
    code = (
        "import resource, sys; from pathlib import Path\n"
        "from aerokernels.files.writing import OutputError\n"
        "from aerokernels.jobs.sweeps.records import CASES_FILE, Records\n"
        "folder = Path(sys.argv[1])\n"
        "hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]\n"
        "for size in (1_500, resource.RLIM_INFINITY):\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))\n"
        "    records = Records(folder)\n"
        "    print(sorted(records.done))\n"
        "    try:\n"
        "        with records.writing():\n"
        "            for case in range(3):\n"
        "                records.add(case, {'error': 'x' * 1000})\n"
        "    except OutputError as fault:\n"
        "        print(fault)\n"
        "    print((folder / CASES_FILE).read_bytes().count(b'\\n'), (folder / CASES_FILE).read_bytes()[-1:])\n"
    )
    done = in_python(code, tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    none, told, first, one, all_ = done.stdout.splitlines()
    assert (none, first, one, all_) == ("[]", "1 b'\\n'", "[0]", "3 b'\\n'")
    assert told.startswith(f"out={tmp_path / 'cases.jsonl'}: ") and told.endswith("make room, or choose another place")


@unix
def test_what_a_kill_leaves_goes_with_the_next_run(tmp_path: Path):
    """A process killed in the middle of its draft; other hidden files stay."""
    code = (
        "import os, signal, sys; from pathlib import Path; from aerokernels.jobs.store import staged_folder\n"
        "with staged_folder(Path(sys.argv[1])) as folder:\n"
        "    (folder / 'half').write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    out = tmp_path / "run"
    assert in_python(code, out).returncode == -signal.SIGKILL
    (abandoned,) = (path for path in tmp_path.iterdir() if path.name != ".run.lock")  # an empty file
    assert (abandoned / "half").is_file() and not out.exists()
    kept = [tmp_path / ".run.partials", tmp_path / ".runs"]
    for other in kept:
        other.mkdir()
    with staged_folder(out) as folder:
        (folder / "whole").write_text("whole")
    assert sorted(tmp_path.iterdir()) == sorted([out, *kept])


@unix
def test_a_result_is_replaced_whole_by_one_process_at_a_time(tmp_path: Path):
    """One holds the folder and is killed while it moves its second file: the other is refused, and then goes on."""
    code = (
        "import os, signal, sys; from pathlib import Path\n"
        "from aerokernels.jobs.store import staged_folder, write_summary\n"
        "moved, replace = [], Path.replace\n"
        "def moving(self, to):\n"
        "    moved.append(self)\n"
        "    os.kill(os.getpid(), signal.SIGKILL) if len(moved) == 2 else replace(self, to)\n"
        "with staged_folder(Path(sys.argv[1])) as folder:\n"
        "    [(folder / name).write_text('new') for name in 'ab']\n"
        "    write_summary(folder / 'summary.json', {'version': 'new'})\n"
        "    print('held', flush=True); input(); Path.replace = moving\n"
    )
    out = tmp_path / "run"
    with staged_folder(out) as folder:
        write_summary(folder / "summary.json", {"version": "old"})
        for name in "abc":
            (folder / name).write_text("old")
    (out / "mine").write_text("old")
    with subprocess.Popen([sys.executable, "-c", code, out], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout and child.stdout.readline() == b"held\n"
        with pytest.raises(ValueError, match=rf"^out={out}: another process is at work there; wait") as refused:
            with staged_folder(out):
                pass
        assert "\n" not in str(refused.value)
        child.communicate(b"\n")
        assert child.returncode == -signal.SIGKILL
    assert [(out / name).read_text() for name in "abc"] == ["new", "old", "old"]
    with pytest.raises(ValueError, match=r"holds no result\.nc"):
        read_run(str(out))
    assert {path.name: path.read_text() for path in out.iterdir() if path.name != "summary.json"} == {
        "a": "new", "b": "new", "mine": "old"}  # fmt: skip
    assert '"new"' in (out / "summary.json").read_text() and list(tmp_path.iterdir()) == [out]


def test_two_processes_do_not_write_one_series(tmp_path: Path):
    """One that writes holds the other off; one that begins with what it read before the first went on is refused."""
    pytest.importorskip("zarr")
    from aerokernels.series.store import KEPT, MAPS, ZarrStore

    axis, path = np.linspace(-0.01, 0.01, 4), tmp_path / "maps.zarr"
    template = xarray.Dataset(coords={"time": np.arange(3.0), "y": axis, "x": axis})
    maps = {name: np.ones((4, 4), kind) for name, (kind, _, _) in MAPS.items()}
    numbers = dict.fromkeys(KEPT, 1.0)
    first, late = (ZarrStore(path, template, lambda count: {"series": "a"}) for _ in range(2))
    with first.writing():
        first.add(maps, numbers)
        with late.writing(), pytest.raises(ValueError, match="another process is at work there"):
            late.add(maps, numbers)
    with late.writing(), pytest.raises(ValueError, match="another process is at work there"):
        late.add(maps, numbers)
    again = ZarrStore(path, template, lambda count: {"series": "a"})
    assert again.done.count == 1
    with again.writing():
        again.add(maps, numbers)
    assert [one.name for one in tmp_path.iterdir()] == ["maps.zarr"]


@unix
def test_a_series_on_a_full_disk_keeps_what_is_done_and_goes_on(tmp_path: Path):
    """Set-up: files that may have no bytes before the first map, and again after the third.

    Expected: reported with the store's name; no draft stays, what was kept is kept, and with room the series is
    finished.
    """
    pytest.importorskip("zarr")
    code = (
        "import resource, sys; from pathlib import Path; import numpy as np; import xarray\n"
        "from aerokernels.files.writing import OutputError\n"
        "from aerokernels.series.store import KEPT, MAPS, ZarrStore\n"
        "axis, path = np.linspace(-0.01, 0.01, 4), Path(sys.argv[1]) / 'maps.zarr'\n"
        "template = xarray.Dataset(coords={'time': np.arange(9.0), 'y': axis, 'x': axis})\n"
        "maps = {name: np.ones((4, 4), kind) for name, (kind, _, _) in MAPS.items()}\n"
        "numbers = dict.fromkeys(KEPT, 1.0)\n"
        "hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]\n"
        "for full_at in (0, 3, 10):\n"
        "    store = ZarrStore(path, template, lambda count: {'series': 'a'})\n"
        "    print(store.done.count)\n"
        "    try:\n"
        "        with store.writing():\n"
        "            while store.done.count < 9:\n"
        "                full = store.done.count == full_at\n"
        "                resource.setrlimit(resource.RLIMIT_FSIZE, (0 if full else resource.RLIM_INFINITY, hard))\n"
        "                store.add(maps, numbers)\n"
        "            print(float(store.finish()['opd'].sum()))\n"
        "    except OutputError as fault:\n"
        "        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, hard))\n"
        "        print(fault)\n"
        "    print(sorted(one.name for one in path.parent.iterdir()))\n"
    )
    done = in_python(code, tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    nothing, told, left, again, full, kept, some, total, there = done.stdout.splitlines()
    assert (nothing, again, left) == ("0", "0", "[]")
    for line in (told, full):
        assert line.startswith(f"out={tmp_path / 'maps.zarr'}: ") and line.endswith(
            "make room, or choose another place"
        )
    assert kept == there == "['maps.zarr']" and (int(some), float(total)) == (3, 144.0)


@unix
def test_a_bare_environment_is_enough(tmp_path: Path):
    """Python -OO in the C locale with no home, no path, no folder for temporary files: answers and refusals stand."""
    code = (
        "import sys, os; os.chdir(sys.argv[1])\n"
        "import aerokernels as ak; from aerokernels.scene import SceneError\n"
        "scene = ak.Scene.load('wind-tunnel-mach3', {'title': 'Mar\\u00e9chal'})\n"
        "open('s.toml', 'w', encoding='utf-8').write('title = \"\\u00e9\"\\n[flow]\\nsource = \"mach3\"\\n')\n"
        "assert_ = ak.Scene.load('s.toml').title == '\\u00e9' and scene.title == 'Mar\\u00e9chal'\n"
        "try: ak.Disc('6 mm', (0, 0, 0))\n"
        "except (TypeError, ValueError) as fault: refused = str(fault)\n"
        "from aerokernels.cli import main; sys.argv[1:] = ['scenes']\n"
        "print(assert_, bool(refused)); main()\n"
    )
    bare = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "HOME": "/nonexistent", "PATH": "",
            "TMPDIR": "/nonexistent", "XDG_CACHE_HOME": "/nonexistent"}  # fmt: skip
    done = in_python(code, tmp_path, options=("-OO",), **bare)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.startswith("True True") and "wind-tunnel-mach3" in done.stdout


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc there")
@pytest.mark.parametrize("name", ["/proc/out", "x" * 254])
def test_a_place_where_no_file_can_be_made_is_told_at_once(name, tmp_path, monkeypatch):
    """A folder that makes none was asked for a file without end; a name that is too long for its lock."""
    monkeypatch.chdir(tmp_path)
    code = """
import sys
from pathlib import Path
from aerokernels.files.writing import only_writer
try:
    with only_writer(Path(sys.argv[1])):
        pass
except ValueError as told:
    print(told)
"""
    assert "no file can be made there" in in_python(code, name).stdout


@pytest.mark.parametrize(
    ("lost", "told"),
    [
        ("opd/c/1/0/0", "opd of snapshot 1, which `done` lists, is lost"),  # came back as a map without a ray
        ("valid/zarr.json", "valid"),
        ("zarr.json", "the store is damaged"),
        ("x/zarr.json", "x is lost from the store"),
    ],
)
def test_a_series_whose_store_has_lost_something_is_not_gone_on_with(tmp_path: Path, lost: str, told: str):
    """Set-up: a finished store without one of its files. Expected: the message names store and fault.

    The numbers stand in `done` too, and are written again.
    """
    pytest.importorskip("zarr")
    from aerokernels.series.store import KEPT, MAPS, ZarrStore

    axis, path = np.linspace(-0.01, 0.01, 4), tmp_path / "maps.zarr"
    template = xarray.Dataset(coords={"time": np.arange(2.0), "y": axis, "x": axis})
    maps = {name: np.ones((4, 4), kind) for name, (kind, _, _) in MAPS.items()}
    with (store := ZarrStore(path, template, lambda count: {"series": "a"})).writing():
        for _ in range(2):
            store.add(maps, dict.fromkeys(KEPT, 0.5))
    store.finish()
    (path / "strehl" / "c" / "0").unlink()
    again = ZarrStore(path, template, lambda count: {"series": "a"})
    assert again.is_finished and (again.finish()["strehl"] == 0.5).all()
    (path / lost).unlink()
    if lost == "zarr.json":
        (path / lost).write_text("{\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"maps\.zarr: .*; take another name, or remove it") as refused:
        again = ZarrStore(path, template, lambda count: {"series": "a"})
        assert again.is_finished
        again.finish()
    assert told in str(refused.value) and "\n" not in str(refused.value)
