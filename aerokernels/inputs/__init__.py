"""What callers give: kinds of arguments, their values, units and wavelengths, checked before any work."""
