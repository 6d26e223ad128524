"""Escape texts in CSV files that a spreadsheet would take for a formula."""

FORMULA = ("=", "+", "-", "@", "\t", "\r")


def text_of_cell(cell: str) -> str:
    """Return the text for which `csv_cell` wrote a cell."""
    text = cell.removeprefix("'")
    return text if csv_cell(text) == cell else cell


def csv_cell(value: object) -> object:
    """Return a cell's value; a text that begins like a formula and is not a number gets a leading apostrophe."""
    if not isinstance(value, str) or not value.lstrip(" ").startswith(FORMULA):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
