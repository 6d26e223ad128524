"""`python -m aerokernels`: the command line."""

from aerokernels.cli import main

if __name__ == "__main__":
    main()
