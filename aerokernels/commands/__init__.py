"""The commands of the command line: each module without an underscore has some, by their names, in COMMANDS."""
