"""Write the OpenCL kernels that are generated from Warp's, in kernels/: the package kernel_generator says how.

    python scripts/generate_kernels.py            after a change of Warp's kernels, layout.py or kinds.h
    python scripts/generate_kernels.py --check    exit status 1 if a file is not what would be written
    python scripts/generate_kernels.py --headers  prints the headers that are made when kernels are compiled

It needs neither a GPU nor a compiler.
"""

import argparse
import sys
from pathlib import Path

import warp as wp

wp.config.quiet = True

from kernel_generator.files import FOLDER, texts  # noqa: E402
from kernel_generator.source import Unsupported  # noqa: E402

from aerokernels.tracing.engines.opencl.program import HEADERS  # noqa: E402

KERNELS = Path(__file__).resolve().parents[1] / "kernels"


def main() -> int:
    """Write or check the files; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; say which files are not current")
    parser.add_argument("--kernels", type=Path, default=KERNELS, help="the folder of kernels (default: %(default)s)")
    parser.add_argument("--headers", action="store_true", help="write nothing; print the headers made from Python")
    given = parser.parse_args()
    if given.headers:
        for name, make in HEADERS.items():
            print(f"// {name}: {make.__doc__}", *make(), "", sep="\n")
        return 0
    try:
        found = texts(KERNELS)
    except Unsupported as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    there = {f"{FOLDER}/{path.name}": path for path in (given.kernels / FOLDER).glob("*.h")}
    stale = [name for name in there if name not in found]
    stale += [name for name, text in found.items() if _read(given.kernels / name) != text]
    if given.check:
        print("\n".join(f"{name} is not current: run scripts/generate_kernels.py" for name in sorted(stale)), end="")
        return 1 if stale else 0
    (given.kernels / FOLDER).mkdir(parents=True, exist_ok=True)
    for name, text in found.items():
        (given.kernels / name).write_text(text, encoding="utf-8")
    for name in there.keys() - found.keys():
        there[name].unlink()
    return 0


def _read(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None


if __name__ == "__main__":
    sys.exit(main())
