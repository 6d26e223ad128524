"""Texts in CSV files that spreadsheets open: one that would be taken for a formula is marked as a text."""

FORMULA = ("=", "+", "-", "@", "\t", "\r")


def csv_cell(value: object) -> object:
    """A value for a cell; a text that begins like a formula, and is no number, gets the apostrophe of a text."""
    if not isinstance(value, str) or not value.lstrip(" ").startswith(FORMULA):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
