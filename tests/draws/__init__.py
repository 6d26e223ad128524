"""Random inputs, fields, bundles, scenes and damaged files, and what must hold of each."""
