"""Format output for people: numbers with their errors, objects in a few lines, and text that is safe to show."""
