"""Record echoes of a digitiser board or an oscilloscope; names of the protocols and of the oscilloscope dialects."""

PROTOCOLS = ("frames", "scpi")
DIALECT_NAMES = ("tektronix", "rigol")
