"""Faults injected for real: no room on the disk, kills, two writers, a bare environment; nothing half-written stays."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from aerokernels.jobs.store import staged_folder

pytestmark = pytest.mark.slow

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
        "from aerokernels.files.writing import OutputError\n"
        "from aerokernels.jobs.store import replace_result, staged_folder, write_result\n"
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
        "    print(store.count)\n"
        "    try:\n"
        "        with store.writing():\n"
        "            while store.count < 9:\n"
        "                full = store.count == full_at\n"
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
