"""The source paper: its printed numbers, and its tables and figures as computed by this package."""
