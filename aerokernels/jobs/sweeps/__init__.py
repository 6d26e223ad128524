"""Sweeps: run one scene for many values of its keys, on many processes, into one labelled dataset."""
