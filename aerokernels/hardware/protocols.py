"""Names of the protocols of the recorder and the simulated board, and of the oscilloscope dialects of "scpi"."""

PROTOCOLS = ("frames", "scpi")
DIALECT_NAMES = ("tektronix", "rigol")
