"""Error against run time and field evaluations: the fields, the runs, their tables and figures."""
