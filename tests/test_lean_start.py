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


def imported(*parts: str) -> list[set[str]]:
    """Modules that a Python has imported after each part of a program."""
    script = "import sys\nbefore = set(sys.modules)\n" + "".join(
        f"try:\n    exec({part!r})\nexcept SystemExit:\n    pass\n"
        "print('modules:', *sorted(set(sys.modules) - before), file=sys.stderr)\n"
        for part in parts
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8")
    found = [set(line.split()[1:]) for line in done.stderr.splitlines() if line.startswith("modules:")]
    assert done.returncode == 0 and len(found) == len(parts), done.stderr
    return found


def foreign(modules: set[str]) -> set[str]:
    """Packages that are neither Python's nor ours."""
    packages = {name.split(".")[0] for name in modules} - set(sys.stdlib_module_names) - {"aerokernels"}
    return {name for name in packages if not name.startswith("_")}


def command(*arguments: str) -> str:
    return f"sys.argv[1:] = {arguments!r}\nimport runpy; runpy.run_module('aerokernels', run_name='__main__')"


def test_help_and_version_need_the_command_lines_parser_only():
    version, its_help, run = map(foreign, imported(command("--version"), command("--help"), command("run", "--help")))
    assert version | its_help <= COMMAND_LINE and run <= PARSED


def test_each_stage_imports_what_it_needs():
    """The package imports no other; a scene is checked without what computes; a field needs linear algebra alone."""
    package, checked, prepared = imported(
        "import aerokernels; dir(aerokernels)",
        "scene = aerokernels.Scene.load('wind-tunnel-mach3')",
        "from aerokernels.prepare import prepare_field\nassert prepare_field(scene).resampling.opd_rms > 0.0",
    )
    assert foreign(package) == set()
    assert not [name for name in checked if name.startswith("scipy")]
    assert not (checked | prepared) & set(SLOW)
