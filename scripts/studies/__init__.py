"""What makes the documents' tables and figures: the source paper's numbers, and error against run time."""
