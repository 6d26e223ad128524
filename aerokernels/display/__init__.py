"""What people read: numbers with their errors, objects in a few lines, and text that is safe to show."""
