"""Readers of flow files, one module or a few for each format; `formats.py` chooses between them."""
