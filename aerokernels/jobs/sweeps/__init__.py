"""Sweeps: one scene over many values of its keys, by many processes, into one labelled dataset."""
