"""Print the headers of the OpenCL kernels that are made from Python, as the compiler gets them.

scripts/kernel_headers [NAME ...]     types.h, constants.h ...; without a name all of them
"""

import argparse

from aerokernels.tracing.engines.opencl.headers import HEADERS


def main() -> None:
    """Print the requested headers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(HEADERS)}")
    names = parser.parse_args().names
    if unknown := set(names) - HEADERS.keys():
        parser.error(f"no header {', '.join(sorted(unknown))}: choose of {', '.join(HEADERS)}")
    for name in names or HEADERS:
        print(f"// {name}: {HEADERS[name].__doc__}", *HEADERS[name](), "", sep="\n")


if __name__ == "__main__":
    main()
