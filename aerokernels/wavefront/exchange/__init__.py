"""Wavefronts handed over to other packages, in their terms and with their signs; each is imported when asked."""
