"""The protocols that the recorder and the simulated board speak, and the oscilloscope dialects of one of them."""

PROTOCOLS = ("frames", "scpi")
DIALECT_NAMES = ("tektronix", "rigol")
