"""An audit of what is installed with the package: licences against an allow-list, and nothing imported undeclared.

It reads what lies beside the interpreter and asks no network.
"""

import re
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

# Licences under which a program may be used, changed and passed on with other programs, by parts of their names.
PERMISSIVE = ("MIT", "BSD", "0BSD", "APACHE", "ISC", "PSF", "PYTHON SOFTWARE FOUNDATION", "ZLIB", "CC0", "HPND")
# Of tools that are not passed on with the package: also those whose own files stay under their licence.
OF_TOOLS = (*PERMISSIVE, "MPL-2.0", "MOZILLA PUBLIC LICENSE 2.0")
# What says nothing of itself in its metadata, looked up by hand: PoCL, its LLVM and hwloc.
LOOKED_UP = {"pocl-binary-distribution": "MIT AND Apache-2.0 AND BSD-3-Clause"}
USED_BY_TOOLS = ("dev",)


def project(root: Path) -> dict:
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def installed_with(requirements: list[str]) -> dict[str, metadata.Distribution]:
    """Distributions that requirements bring, and what those bring, as far as they are installed."""
    found, seen, waiting = {}, set(), [(text, "") for text in requirements]
    while waiting:
        text, extra = waiting.pop()
        one = Requirement(text)
        if one.marker is not None and not one.marker.evaluate({"extra": extra}):
            continue
        for own in ("", *one.extras):
            name = plain(one.name)
            if name == "aerokernels" or (name, own) in seen:
                continue
            seen.add((name, own))
            try:
                found[name] = metadata.distribution(name)
            except metadata.PackageNotFoundError:
                continue
            waiting += [(inner, own) for inner in found[name].requires or ()]
    return found


def licence(name: str, found: metadata.Distribution) -> str:
    """What a distribution says of its licence: an expression, else its classifiers, else the first line of its text."""
    about = found.metadata
    classifiers = [one.rpartition("::")[2].strip() for one in about.get_all("Classifier", []) if "License ::" in one]
    text = " ".join((about.get("License") or "").split())[:60]
    return about.get("License-Expression") or " AND ".join(classifiers) or LOOKED_UP.get(name) or text


def allowed(words: str, names: tuple[str, ...]) -> bool:
    """Whether one of the alternatives is made of allowed licences alone."""
    ways = re.split(r"\s+OR\s+", words.strip("() "))
    return any(
        all(any(part.strip("() ").upper().startswith(name) or f" {name}" in part.upper() for name in names)
            for part in re.split(r"\s+AND\s+", way))
        for way in ways if way
    )  # fmt: skip


def test_everything_installed_with_the_package_has_a_permissive_licence(root: Path):
    about = project(root)
    extras = about["optional-dependencies"]
    shipped = list(about["dependencies"]) + [one for extra in ("opencl", "cfd", "dask") for one in extras[extra]]
    tools = [one for extra in USED_BY_TOOLS for one in extras[extra]]
    found = {name: (one, PERMISSIVE) for name, one in installed_with(shipped).items()}
    found = {name: (one, OF_TOOLS) for name, one in installed_with(tools).items()} | found
    assert len(found) > 30, "the environment was not found"
    wrong = {name: licence(name, one) for name, (one, names) in found.items() if not allowed(licence(name, one), names)}
    assert not wrong


# Imported where a user has them, and no part of an extra.
IMPORTED_IF_THERE: set[str] = set()
# Declared because xarray needs it to write what it writes.
UNSEEN: set[str] = set()
