"""The error budget of a trace, by cause, and what rays may lose where the known air ends."""
