"""Whole jobs: runs, series, comparisons and picture jobs, with their stored results, figures and reports."""
