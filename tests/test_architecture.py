"""The architecture as a test: imports run one way, heavy packages wait, names are documented, nothing reads outside."""

import ast
import functools
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "aerokernels"

# Low to high. A package may import packages of lower rank, and its own.
RANK = {
    package: rank
    for rank, packages in enumerate(
        [
            ("process", "sobol"),
            ("derived", "files", "inputs"),
            ("display",),
            ("sensor",),
            ("pupils",),
            ("device_arrays",),
            ("rays",),
            ("medium",),
            ("flow",),
            ("scene", "scenes"),
            ("tracing",),
            ("zernike", "vtk_files"),
            ("wavefronts",),
            ("focus", "benches", "imaging", "fldi"),
            ("prepare",),
            ("series",),
            ("waves",),
            ("lidar",),
            ("hardware", "compare"),
            ("jobs",),
            ("benchmark",),
            ("commands",),
            ("cli",),
            ("old_modules",),
            ("__main__",),
        ]
    )
    for package in packages
}
HEAVY = (
    "warp",
    "pyopencl",
    "matplotlib",
    "xarray",
    "h5netcdf",
    "h5py",
    "scipy.interpolate",
    "scipy.optimize",
    "pandas",
)

MODULES = sorted(path for path in PACKAGE.rglob("*.py") if "__pycache__" not in path.parts)
assert len(MODULES) > 10, "the package was not found"


@functools.cache
def tree(path: Path) -> ast.Module:
    """The syntax tree of a file, one for all tests."""
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def imports(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """Every import of a file, wherever it is: statements are searched, not the expressions in them."""
    found: list[ast.Import | ast.ImportFrom] = []
    inside: list[ast.AST] = [tree(path)]
    while inside:
        node = inside.pop()
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            found.append(node)
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            below = getattr(node, part, None)
            inside += below if isinstance(below, list) else []
    return found


def dotted(path: Path) -> tuple[str, ...]:
    """("aerokernels", "medium", "mesh") for aerokernels/medium/mesh.py; a package's __init__ stands for the package."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" and len(parts) > 2 else parts


def imported(path: Path) -> set[tuple[int, str]]:
    """(line, package) of everything that the module imports from this package, wherever in the module it does so."""
    here = dotted(path)
    package = here if path.name == "__init__.py" else here[:-1]
    found = set()
    for node in imports(path):
        if isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
        else:
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            base += node.module.split(".") if node.module else []
            # `from aerokernels import flow` names a package only in what is imported
            names = [[*base, alias.name] for alias in node.names] if len(base) < 2 else [base]
        own = (["__version__"], ["attributes_of"])  # of the package itself
        names = [name for name in names if name[0] == PACKAGE.name and name[1:] not in own]
        found |= {(node.lineno, name[1] if len(name) > 1 else "") for name in names}
    return found


def test_imports_run_from_later_stages_to_earlier_ones():
    faults = []
    for path in MODULES:
        package = dotted(path)[1]
        if package == "__init__":
            continue  # it only hands names out
        assert package in RANK, f"{path}: a new package; give it its rank in this test"
        for line, other in sorted(imported(path)):
            if other not in RANK:
                faults.append(f"{path}:{line}: imports {other or 'the whole package'!r}, no package with a rank")
            elif other != package and RANK[other] >= RANK[package]:
                faults.append(f"{path}:{line}: {package} may not import {other}")
    assert not faults, "\n".join(faults)


def imported_modules(path: Path, modules: dict[tuple[str, ...], Path]) -> set[tuple[str, ...]]:
    """Dotted names of the modules of this package that a module imports, wherever in the module it does so."""
    here = dotted(path)
    package = here if path.name == "__init__.py" else here[:-1]
    found = set()
    for node in imports(path):
        if isinstance(node, ast.Import):
            names = [tuple(alias.name.split(".")) for alias in node.names]
        else:
            base = package[: len(package) - node.level + 1] if node.level else ()
            base += tuple(node.module.split(".")) if node.module else ()
            # A name in a package is a module of it, or one of its own.
            names = [(*base, alias.name) if (*base, alias.name) in modules else base for alias in node.names]
        found |= {name for name in names if name in modules}
    return found - {here}


def test_no_modules_import_each_other_in_a_circle():
    """Inside packages too, and in functions: whoever wants to read one module can do so after those it imports."""
    modules = {dotted(path): path for path in MODULES}
    open_ends = {name: imported_modules(path, modules) for name, path in modules.items()}
    while True:
        free = [name for name, others in open_ends.items() if not others & open_ends.keys()]
        if not free:
            break
        for name in free:
            del open_ends[name]
    circle = {".".join(name): sorted(".".join(other) for other in others & open_ends.keys())
              for name, others in open_ends.items()}  # fmt: skip
    assert not circle


def outliving_calls(tree: ast.Module) -> list[str]:
    """What a module keeps from one call to the next: decorators that cache, `global`, containers that functions fill.

    Also objects of a class of the package that may change: `OPENED` of opened.py is the only one that is allowed.
    """
    found = []
    functions = [node for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]
    for function in functions:
        for decorator in function.decorator_list:
            name = ast.unparse(decorator).split("(")[0].split(".")[-1]
            if name in ("cache", "lru_cache"):
                found.append(f"@{name} {function.name}")
    held = set()
    for node in tree.body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            held |= {ast.unparse(target) for target in getattr(node, "targets", None) or [node.target]}
            if isinstance(node.value, ast.Call) and ast.unparse(node.value).startswith("Opened("):
                found.append(ast.unparse(node))
    for node in (inner for function in functions for inner in ast.walk(function)):
        if isinstance(node, ast.Global):
            found += [f"global {name}" for name in node.names]
        changed = None
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in FILLS:
            changed = node.func.value
        elif isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Load):
            changed = node.value
        if isinstance(changed, ast.Name) and changed.id in held:
            found.append(f"{changed.id} is filled")
    return found


FILLS = ("append", "add", "update", "setdefault", "extend", "insert", "pop", "popitem", "clear", "remove", "discard")


def test_nothing_but_one_object_outlives_calls():
    """No caches in modules: what is kept belongs to a field, a result or a prepared object, or to OPENED.

    What is made of the package's own files alone may be kept.
    """
    found = {".".join(dotted(path)): outliving_calls(tree(path)) for path in MODULES}
    assert {name: kept for name, kept in found.items() if kept} == {
        "aerokernels.inputs.kinds": ["@cache kinds_of"],
        "aerokernels.process.opened": ["OPENED = Opened()"],
        "aerokernels.tracing.engines.choice": ["@lru_cache _best"],
        "aerokernels.tracing.engines.layout": ["@cache parts_of", "@cache number_type"],
        "aerokernels.tracing.engines.opencl.program": ["@cache _made_header", "@lru_cache build_options"],
    }


# A library that raises one class for everything, without a code: Warp's errors of memory, NumPy's of its numbers.


def test_import_is_light():
    """`import aerokernels` loads none of the heavy packages, nor does naming the command line's help."""
    for statement in ("import aerokernels", "import aerokernels.cli", "import aerokernels; dir(aerokernels)"):
        code = f"{statement}\nimport sys\nprint(*[name for name in {HEAVY!r} if name in sys.modules])"
        loaded = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True
        ).stdout.split()
        assert loaded == [], f"{statement!r} loads {loaded}"


def test_public_names_are_there_and_documented():
    import aerokernels

    names = aerokernels.__all__
    assert len(names) == len(set(names)) and not [
        name for name in names if name.startswith("_") and name != "__version__"
    ]
    assert set(names) <= set(dir(aerokernels))
    for name in names:
        thing = getattr(aerokernels, name)
        if not isinstance(thing, str):
            assert inspect.getdoc(thing), f"aerokernels.{name} has no docstring"
    with pytest.raises(AttributeError, match="no_such_name"):
        aerokernels.no_such_name  # noqa: B018


NAMES = (
    "import warnings; warnings.simplefilter('error')\n"
    "import aerokernels as ak, importlib, inspect, pickle\n"
    "for name in ('echo', 'schlieren', 'strehl', 'wavefront'):\n"
    "    function = getattr(ak, name)\n"
    "    assert inspect.isfunction(function) and pickle.loads(pickle.dumps(function)) is function\n"
    "from aerokernels import echo, schlieren, strehl, wavefront\n"
    "assert abs(ak.strehl([0.0, 0.0], 1e-6) - 1.0) < 1e-12\n"
    "import aerokernels.lidar, aerokernels.focus, aerokernels.wavefronts, aerokernels.benches\n"
    "assert inspect.isfunction(ak.echo)\n"
)
OLD = (
    "with warnings.catch_warnings(record=True) as told:\n"
    "    warnings.simplefilter('always')\n"
    "    names = ('echo', 'schlieren', 'strehl', 'wavefront')\n"
    "    old = [importlib.import_module(f'aerokernels.{name}') for name in names]\n"
    "assert [one.category for one in told] == 4 * [DeprecationWarning] and 'lidar' in str(told[0].message), told\n"
    "assert callable(old[0].plane_target_echo) and callable(old[1].shadowgraph) and callable(old[3].Wavefront)\n"
    "assert abs(ak.strehl([0.0, 0.0], 1e-6) - 1.0) < 1e-12 and callable(ak.echo)\n"
)


def test_names_of_functions_are_functions_and_old_modules_warn():
    """No name or call warns; an import of a package by its old name does, and the name can be called after it too."""
    done = subprocess.run([sys.executable, "-c", NAMES + OLD], capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr


def test_all_equals_the_documented_names(root: Path):
    """docs/api.md lists each public name once, at the head of a line."""
    import aerokernels

    page = (root / "docs" / "api.md").read_text(encoding="utf-8")
    documented = re.findall(r"^- `([\w.]+)`: ", page, flags=re.MULTILINE)
    assert sorted(documented) == sorted(aerokernels.__all__)


def test_every_name_on_the_architecture_page_is_a_name_of_the_code():
    """Paths exist, in words and in pictures; names in backticks are defined in the package."""
    root = PACKAGE.parent
    page = (root / "docs" / "architecture.md").read_text(encoding="utf-8")
    paths = {path.rstrip("./") for path in re.findall(r"\b(?:aerokernels|kernels|scripts|tests)/[\w./]+", page)}
    inner = root / "aerokernels" / "tracing" / "engines"
    assert len(paths) > 25
    homes = [root, inner / "warp", inner.parent]
    assert not [path for path in sorted(paths) if not any((home / path).exists() for home in homes)]
    sources = "".join(path.read_text(encoding="utf-8") for path in MODULES)
    words = set(re.findall(r"\b(?:def|class) (\w+)", sources))
    reported = {name for name in re.findall(r"`([A-Za-z_]\w+)`", page) if name not in ("engines",)}
    assert len(reported) > 5 and not sorted(reported - words)


def test_every_answer_of_the_architecture_page_is_in_the_two_files_it_names():
    """The table of questions: names in an answer are in one of its files, of which there are at most two."""
    page = (PACKAGE.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("## Questions and answers")[2].partition("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ") and "?" in line]
    assert len(rows) >= 10
    for question, answer, files in rows:
        paths = [PACKAGE.parent / name for name in re.findall(r"`([^`]+)`", files)]
        texts = "".join(path.read_text(encoding="utf-8") for path in paths)
        missing = [name for name in re.findall(r"`(\w+)`", answer) if not re.search(rf"\b{name}\b", texts)]
        assert 1 <= len(paths) <= 2 and not missing, f"{question} {missing}"
