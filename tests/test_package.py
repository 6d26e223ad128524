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
        text=True,
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
    assert b"aerokernels = aerokernels.cli:main" in points
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
