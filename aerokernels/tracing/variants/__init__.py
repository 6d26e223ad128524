"""Errors by cause: some rays of a run, and what differs where one thing about the run is done another way."""
