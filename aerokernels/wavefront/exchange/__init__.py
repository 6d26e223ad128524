"""Export of wavefronts to other packages and formats, in their units and signs; each package is imported when used."""
