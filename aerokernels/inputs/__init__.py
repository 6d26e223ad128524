"""Check the caller's input before any work: kinds of arguments, their values, units and wavelengths."""
