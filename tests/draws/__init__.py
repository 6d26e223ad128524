"""Random inputs, fields, bundles, scenes and damaged files, with what must hold of each; scripts/fuzz_* take them too."""
