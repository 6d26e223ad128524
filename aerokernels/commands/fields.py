"""`aerokernels fields`: the flow fields that ship with the library."""


def fields() -> None:
    """Show the shipped flow fields: Mach number, free stream, mesh and provenance."""
    from aerokernels.commands._table import print_table
    from aerokernels.flow import shipped, shipped_names

    rows = []
    for name in shipped_names():
        field = shipped(name)
        stream = field.conditions
        rows.append(
            (
                name,
                f"{stream.mach:g}" if stream else "-",
                f"{field.ambient_density:.4f} kg/m3",
                f"{stream.pressure:.0f} Pa" if stream else "-",
                f"{stream.temperature:.2f} K" if stream else "-",
                f"{stream.velocity:.1f} m/s" if stream else "-",
                f"{field.density.min():.3f} to {field.density.max():.3f} kg/m3",
                f"{len(field.mesh.cells)} cells, {field.geometry}",
                field.provenance,
            )
        )
    columns = ("field", "Mach", "free stream", "pressure", "temperature", "velocity", "density", "mesh", "provenance")
    print_table("Shipped flow fields", columns, rows)
