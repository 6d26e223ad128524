"""A lean start: which packages each stage of the way may import.

Seconds are measured elsewhere (docs/performance.md); what costs them is held here, since it is the same on any machine.
"""

import subprocess
import sys

# What the parser of the command line brings along.
COMMAND_LINE = {"typer", "rich", "shellingham", "annotated_doc", "markdown_it", "mdurl", "pygments", "click"}
COMMAND_LINE |= {"attr", "attrs"}  # rich imports them where they are installed
PARSED = COMMAND_LINE | {"typing_extensions", "pydantic", "pydantic_core", "annotated_types", "typing_inspection"}
# Packages, and parts of packages, that take a tenth of a second and more.
SLOW = ("warp", "pyopencl", "matplotlib", "pandas", "xarray", "h5py", "scipy.stats", "scipy.signal", "scipy.optimize")


def imported(code: str, *arguments: str) -> set[str]:
    """Modules that `code` adds to those of a Python that does nothing."""
    script = (
        f"import sys\nbefore = set(sys.modules)\ntry:\n    exec({code!r})\n"
        "finally:\n    print('modules:', *sorted(set(sys.modules) - before), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, encoding="utf-8")
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 0 and last.startswith("modules:"), done.stderr
    return set(last.split()[1:])


def foreign(modules: set[str]) -> set[str]:
    """Packages that are neither Python's nor ours."""
    packages = {name.split(".")[0] for name in modules} - set(sys.stdlib_module_names) - {"aerokernels"}
    return {name for name in packages if not name.startswith("_")}


def command(*arguments: str) -> set[str]:
    return imported("import runpy; runpy.run_module('aerokernels', run_name='__main__')", *arguments)


def slow(modules: set[str]) -> set[str]:
    return modules & set(SLOW)


def test_importing_the_package_imports_no_other():
    assert foreign(imported("import aerokernels; dir(aerokernels)")) == set()


def test_help_and_version_need_the_command_lines_parser_only():
    assert foreign(command("--version")) <= COMMAND_LINE
    assert foreign(command("--help")) <= COMMAND_LINE
    assert foreign(command("run", "--help")) <= PARSED


def test_a_scene_is_checked_without_what_computes():
    """A scene that does not exist is refused, and the shipped ones are listed, before anything slow is imported."""
    modules = imported("import aerokernels; aerokernels.Scene.load('wind-tunnel-mach3')")
    assert not slow(modules) and not [name for name in modules if name.startswith("scipy")]


def test_a_field_is_prepared_by_arrays_and_linear_algebra_alone():
    modules = imported(
        "from aerokernels.scene import Scene\nfrom aerokernels.prepare import prepare_field\n"
        "assert prepare_field(Scene.load('wind-tunnel-mach3')).resampling.opd_rms > 0.0"
    )
    assert not slow(modules)
