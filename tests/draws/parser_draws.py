"""Every kind of random input for a parser, by name: a draw takes a random generator and a folder of its own.

It returns whether the input was accepted; an input refused in words was not. Any other outcome is an exception.
"""

from . import file_draws, input_draws

PARTS = (input_draws, file_draws)
DRAWS = {name: draw for part in PARTS for name, draw in part.DRAWS.items()}
