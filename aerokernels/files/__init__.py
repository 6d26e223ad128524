"""Write files whole or not at all, by one process at a time, and read and write NetCDF files."""
