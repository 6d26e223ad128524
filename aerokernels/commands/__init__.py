"""The commands of the command line: each module holds one function of its own name, and cli.py finds it by that."""
