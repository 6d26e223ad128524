"""Machines on which the usual folders for kernels cannot be used: full, read-only, or named in another encoding."""

import os
from pathlib import Path

import pytest

from aerokernels.process.kernel_cache import why_untrusted

from ..opencl_stands import need_opencl, run_python

pytestmark = pytest.mark.slow

# Free space and rights as Python sees them, in place of a full or read-only disk, which only root can mount.
STAND = """
import os
from pathlib import Path
from aerokernels.process import kernel_cache
real = kernel_cache.why_unusable
def why_unusable(folder):
    return f"the disk of {folder} is full" if any(str(folder).startswith(one) for one in %r) else real(folder)
kernel_cache.why_unusable = why_unusable
"""
START = """
from aerokernels.process.quiet_warp import start_warp
import warp as wp
start_warp()
place = Path(wp.config.kernel_cache_dir)
print(place)
print(sorted(path.relative_to(place).as_posix() for path in place.rglob("wp_*.o")))
"""
CHOOSE = "from aerokernels.tracing.engines.choice import choose_backend; print(choose_backend({!r}, 'cpu')[0])\n"


def test_a_full_disk_gives_warp_a_cache_of_its_own_with_the_kernels_it_has(tmp_path):
    """It ended in an OSError from Warp. Expected: modules of the full cache are used from the new one."""
    full, temporary = tmp_path / "full", tmp_path / "temporary"
    temporary.mkdir()
    places = {"WARP_CACHE_PATH": str(full), "TMPDIR": str(temporary)}
    usual = Path(run_python("from pathlib import Path\n" + START, tmp_path, **places).stdout.splitlines()[0])
    assert usual.is_relative_to(full)
    for name, code in {"wp_whole": b"code", "wp_made_p1_t2": b"code", "wp_empty": b""}.items():
        (usual / name).mkdir()
        (usual / name / f"{name}.o").write_bytes(code)
    done = run_python(STAND % [str(full)] + START, tmp_path, **places)
    place, modules = done.stdout.splitlines()
    assert place.startswith(str(temporary)) and modules == "['wp_whole/wp_whole.o']", done.stderr
    assert "is full: kernels are built in" in done.stderr and not list(temporary.iterdir())
    assert (usual / "wp_empty" / "wp_empty.o").exists()


@pytest.mark.parametrize("backend", ["warp", "opencl", "auto"])
def test_where_no_folder_takes_kernels_a_sentence_says_what_to_set(backend, tmp_path):
    """PoCL and LLVM ended the process by SIGABRT, and Warp raised an error of its own."""
    if backend == "opencl" and "PoCL" not in need_opencl().info.description:
        pytest.skip("no PoCL here")
    places = dict.fromkeys(("XDG_CACHE_HOME", "POCL_CACHE_DIR", "WARP_CACHE_PATH", "TMPDIR"), str(tmp_path))
    start = "from aerokernels.process.quiet_warp import start_warp; start_warp()\n" if backend == "auto" else ""
    done = run_python(STAND % [str(tmp_path)] + CHOOSE.format(backend) + start, tmp_path, **places)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "is full" in last and "set TMPDIR to a folder" in last, done.stderr


def test_a_variable_that_is_empty_leaves_pocl_its_cache(tmp_path):
    """PoCL took "" for a folder's name, and the message asked for a variable that was set."""
    if "PoCL" not in need_opencl().info.description:
        pytest.skip("no PoCL here")
    places = {"POCL_CACHE_DIR": "", "XDG_CACHE_HOME": "", "HOME": str(tmp_path)}
    done = run_python(CHOOSE.format("opencl"), tmp_path, PYOPENCL_NO_CACHE="1", **places)
    assert (done.returncode, done.stdout) == (0, "opencl\n"), done.stderr
    assert (tmp_path / ".cache" / "pocl" / "kcache").is_dir()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="each user has folders of his own here")
def test_a_folder_that_others_may_write_is_told(tmp_path, monkeypatch):
    """Owners and modes as an attacker may leave them; only root can give a folder away."""
    folder = tmp_path / "over" / "kernels"
    folder.mkdir(parents=True)
    for mode, place in ((0o777, folder), (0o1777, folder), (0o702, folder), (0o777, folder.parent)):
        assert why_untrusted(folder) == ""
        place.chmod(mode)
        assert why_untrusted(folder) == f"{place} may be written by other users"
        place.chmod(0o755)
    folder.parent.chmod(0o1777)  # as /tmp: others make files there, and leave this folder alone
    folder.chmod(0o775)  # of this user's own group, as where each user has one
    assert why_untrusted(folder) == ""
    (tmp_path / "link").symlink_to(folder)
    assert why_untrusted(tmp_path / "link") == ""
    assert "cannot be examined" in why_untrusted(tmp_path / "none")
    if os.geteuid() == 0:
        for place in (folder, folder.parent):
            os.chown(place, 65534, 65534)
            assert why_untrusted(folder) == f"{place} belongs to another user"
            os.chown(place, 0, 0)
        os.lchown(tmp_path / "link", 65534, 65534)
        assert why_untrusted(tmp_path / "link") == f"{tmp_path / 'link'} belongs to another user"
        os.chown(folder, 0, 65534)
        assert why_untrusted(folder) == f"{folder} may be written by other users"


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="each user has folders of his own here")
@pytest.mark.parametrize("backend", ["warp", "opencl"])
def test_kernels_are_not_loaded_from_a_folder_that_others_may_write(backend, tmp_path):
    """Without HOME PoCL keeps kernels in /tmp/pocl, whoever made it: his library ran as this user."""
    if backend == "opencl" and "PoCL" not in need_opencl().info.description:
        pytest.skip("no PoCL here")
    caches, temporary = tmp_path / "caches", tmp_path / "temporary"
    for place, mode in ((caches, 0o777), (temporary, 0o755)):
        place.mkdir()
        place.chmod(mode)
    places = {"XDG_CACHE_HOME": str(caches), "WARP_CACHE_PATH": str(caches / "warp"), "TMPDIR": str(temporary)}
    start = "from aerokernels.process.quiet_warp import start_warp; start_warp()\n" if backend == "warp" else ""
    done = run_python(CHOOSE.format(backend) + start, tmp_path, POCL_CACHE_DIR="", **places)
    assert (done.returncode, done.stdout) == (0, f"{backend}\n"), done.stderr
    assert f"{caches} may be written by other users: kernels are built in {temporary}" in done.stderr
    assert not list(caches.rglob("*.so")) and not list(temporary.iterdir())


def test_a_kernel_that_cannot_be_written_names_the_cache_and_the_remedy():
    """As with `ulimit -f`, or a disk that fills while the process runs: only "[Errno 27] File too large" before."""
    from aerokernels.device_arrays import launching
    from aerokernels.process.kernel_cache import NoCacheError
    from aerokernels.process.quiet_warp import start_warp

    class Module:
        def load(self, device, block_size):
            raise OSError(launching.errno.EFBIG, "File too large")

    start_warp()
    with pytest.raises(NoCacheError, match=r"File too large.*ulimit -f.*WARP_CACHE_PATH"):
        launching.load_module(Module(), "cpu", 1)
