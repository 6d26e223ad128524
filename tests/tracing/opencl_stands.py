"""OpenCL set-ups of tests: devices, skipped visibly where absent, processes with a broken OpenCL, a driver in C."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

# A driver with one platform of one GPU, as far as listing it goes. MODE 0: the GPU lacks float64; otherwise asking for
# devices gives that error code (-1: there are none).
DRIVER = r"""
#include <stddef.h>
#include <stdint.h>
#include <string.h>
typedef int32_t (*entry)(void);
static int32_t nothing(void) { return 0; }
struct object { entry *dispatch; };
static entry table[256];
static struct object platform = {table}, device = {table};

static int32_t give(const void *from, size_t bytes, size_t size, void *to, size_t *needed) {
  if (needed) *needed = bytes;
  if (to) { if (size < bytes) return -30; memcpy(to, from, bytes); }
  return 0;
}
#define TEXT(text) give(text, strlen(text) + 1, size, value, needed)
#define NUMBER(type, number) { type x = number; return give(&x, sizeof x, size, value, needed); }

static int32_t platform_info(void *p, uint32_t name, size_t size, void *value, size_t *needed) {
  switch (name) {
    case 0x0900: return TEXT("FULL_PROFILE");
    case 0x0901: return TEXT("OpenCL 1.2 stand");
    case 0x0902: return TEXT("Stand Platform");
    case 0x0903: return TEXT("Stand");
    case 0x0904: return TEXT("cl_khr_icd");
    case 0x0920: return TEXT("STAND");
  }
  return -30;
}
static int32_t device_info(void *d, uint32_t name, size_t size, void *value, size_t *needed) {
  switch (name) {
    case 0x1000: NUMBER(uint64_t, 4)
    case 0x1002: NUMBER(uint32_t, 64)
    case 0x101F: NUMBER(uint64_t, 1u << 30)
    case 0x1027: case 0x1028: NUMBER(uint32_t, 1)
    case 0x102B: return TEXT("Stand GPU");
    case 0x102D: case 0x102F: return TEXT("OpenCL 1.2 stand");
    case 0x1030: return TEXT("cl_khr_global_int32_base_atomics");
    case 0x1031: NUMBER(void *, &platform)
    case 0x1032: NUMBER(uint64_t, 0)
  }
  return -30;
}
static int32_t device_ids(void *p, uint64_t kind, uint32_t room, void **devices, uint32_t *count) {
  if (MODE) return MODE;
  if (devices && room) devices[0] = &device;
  if (count) *count = 1;
  return 0;
}
static int32_t platform_ids(uint32_t room, void **platforms, uint32_t *count) {
  for (int i = 0; i < 256; i++) if (!table[i]) table[i] = nothing;
  table[1] = (entry)platform_info; table[2] = (entry)device_ids; table[3] = (entry)device_info;
  if (platforms && room) platforms[0] = &platform;
  if (count) *count = 1;
  return 0;
}
int32_t clIcdGetPlatformIDsKHR(uint32_t room, void **platforms, uint32_t *count) {
  return platform_ids(room, platforms, count);
}
int32_t clGetPlatformInfo(void *p, uint32_t name, size_t size, void *value, size_t *needed) {
  return platform_info(p, name, size, value, needed);
}
void *clGetExtensionFunctionAddress(const char *name) {
  return strcmp(name, "clIcdGetPlatformIDsKHR") ? NULL : (void *)clIcdGetPlatformIDsKHR;
}
"""


def need_opencl(kind=None):
    """An OpenCL device that can trace, of a kind if one is named; without one the test is skipped, with the reason."""
    from aerokernels.tracing.engines.opencl.devices import OpenCLUnavailable, find_device

    try:
        return find_device(kind)
    except (OpenCLUnavailable, ValueError) as error:
        pytest.skip(str(error))


def run_python(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=300,
    )


def before_path(folder: Path) -> str:
    """PYTHONPATH with a folder first."""
    return os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])


def vendors(folder: Path, **drivers: str) -> str:
    """A folder for OCL_ICD_VENDORS with a file for each driver, naming its library."""
    place = folder / "vendors"
    place.mkdir()
    for name, library in drivers.items():
        (place / f"{name}.icd").write_text(library + "\n")
    return str(place)


def bare_pyopencl(folder: Path) -> str:
    """PYTHONPATH with PyOpenCL as installed alone, without the drivers that pip's extra `pocl` puts into it."""
    pyopencl = pytest.importorskip("pyopencl")
    source = Path(pyopencl.__file__).parent
    if not sys.platform.startswith("linux") or not (source / ".libs").is_dir():
        pytest.skip("PyOpenCL is not installed from a wheel for Linux")
    copy = folder / "bare" / "pyopencl"
    (copy / ".libs").mkdir(parents=True)
    for path in source.iterdir():
        if path.name != ".libs":
            (copy / path.name).symlink_to(path)
    for path in (source / ".libs").glob("libOpenCL*"):
        shutil.copy(path, copy / ".libs")
    return before_path(copy.parent)


def driver(folder: Path, mode: int) -> str:
    """DRIVER, compiled."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("no C compiler for Linux here to make a driver with")
    pytest.importorskip("pyopencl")
    (folder / "stand.c").write_text(DRIVER)
    library = folder / "libstand.so"
    subprocess.run(
        [compiler, "-shared", "-fPIC", f"-DMODE={mode}", "-o", library, folder / "stand.c"], check=True, timeout=60
    )
    return str(library)
