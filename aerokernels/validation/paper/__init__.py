"""The source paper: the numbers it prints, and its tables and figures as this package gets them."""
