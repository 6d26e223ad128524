"""The wheel carries everything that the library needs at run time."""

import ast
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def wheel_names(root: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Contents of the wheel by name; built without network, with the backend that is installed."""
    folder = tmp_path_factory.mktemp("wheel")
    made = subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, root],
        capture_output=True,
        encoding="utf-8",
    )
    assert made.returncode == 0, made.stdout + made.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def shipped(folder: Path) -> dict[str, bytes]:
    """Files under `folder` by their path below it, without what Python leaves there."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_kernels_in_the_wheel_are_those_of_the_checkout(root: Path, wheel_names: dict[str, bytes]):
    kernels = shipped(root / "kernels")
    assert kernels
    prefix = "aerokernels/kernels/"
    in_wheel = {name.removeprefix(prefix): data for name, data in wheel_names.items() if name.startswith(prefix)}
    assert in_wheel == kernels


def test_package_in_the_wheel_is_that_of_the_checkout(root: Path, wheel_names: dict[str, bytes]):
    package = shipped(root / "aerokernels")
    missing = [name for name, data in package.items() if wheel_names.get(f"aerokernels/{name}") != data]
    assert not missing
    suffixes = {Path(name).suffix for name in package}
    assert {".npz", ".toml", ".py"} <= suffixes, "flow fields and scenes ship inside the package"
    assert "aerokernels/py.typed" in wheel_names


def test_wheel_names_the_command_and_the_licence(wheel_names: dict[str, bytes]):
    (points,) = [data for name, data in wheel_names.items() if name.endswith("entry_points.txt")]
    assert b"aerokernels = aerokernels.__main__:main" in points
    assert [name for name in wheel_names if name.endswith("licenses/LICENSE")]
    assert not [name for name in wheel_names if name.startswith(("tests/", "scripts/"))]


def normalised(name: str) -> str:
    """A distribution's name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_package_that_is_imported_is_declared(root: Path):
    """What the library imports stands in pyproject.toml itself, not only behind some other package's dependencies."""
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"], *(line for extra in project["optional-dependencies"].values() for line in extra)]
    declared = {normalised(re.match(r"[\w.-]+", line)[0]) for line in lines}  # type: ignore[index]
    providers = packages_distributions()
    for path in (root / "aerokernels").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                tops = {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                tops = {str(node.module).split(".")[0]}
            else:
                continue
            for top in tops - set(sys.stdlib_module_names) - {"aerokernels"}:
                if top not in providers:
                    assert normalised(top) in declared, f"{path}:{node.lineno}: {top}"
                    continue
                known = {normalised(name) for name in providers[top]}
                assert known & declared, f"{path}:{node.lineno}: {top} comes with {known}, which pyproject.toml lacks"


@pytest.mark.parametrize(
    ("system", "machine", "version", "expected"),
    [
        ("linux", "x86_64", "3.11", True),
        ("linux", "x86_64", "3.14", True),
        ("linux", "x86_64", "3.15", False),
        ("linux", "aarch64", "3.12", False),
        ("darwin", "arm64", "3.12", False),
        ("darwin", "x86_64", "3.12", False),
        ("win32", "AMD64", "3.12", False),
    ],
)
def test_opencl_is_installed_where_wheels_are(root: Path, system: str, machine: str, version: str, expected: bool):
    """PyPI has PoCL for 64-bit Linux on x86 only: asked for elsewhere, nothing at all would be installed."""
    from packaging.requirements import Requirement

    place = {"sys_platform": system, "platform_machine": machine, "python_version": version}
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    core = {line.name: line for line in map(Requirement, project["dependencies"])}
    assert core["pyopencl"].extras == {"pocl"} and core["pyopencl"].marker.evaluate(place) == expected
    assert core["warp-lang"].marker is None
    extra = [Requirement(line) for line in project["optional-dependencies"]["opencl"]]
    assert not [line for line in extra if line.extras], "the old extra asks for no more than a wheel that is everywhere"


def test_extras_install_only_what_is_imported(root: Path):
    """Beside the tools of `dev` and `docs`, what an extra brings is imported in the package or by scripts/peers."""
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    assert {"opencl", "cfd", "dask", "plot", "dev", "all"} <= set(project["optional-dependencies"])
    files = [*(root / "aerokernels").rglob("*.py"), root / "scripts" / "peers.py"]
    sources = [path.read_text(encoding="utf-8") for path in files]
    for extra, lines in project["optional-dependencies"].items():
        for line in lines if extra not in ("dev", "docs", "all") else []:
            name = re.match(r"[\w-]+", line)[0].replace("-", "_")  # type: ignore[index]
            if name == "numcodecs":  # zarr's: a floor only, older ones run code that a store holds
                continue
            assert any(re.search(rf"\bimport {name}\b|\bfrom {name}\b|\"{name}[\".]", text) for text in sources), line
