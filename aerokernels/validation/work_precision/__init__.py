"""Error against run time and field evaluations: the fields, the runs, and their tables and pictures."""
