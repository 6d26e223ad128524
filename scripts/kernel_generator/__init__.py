"""OpenCL C from the device functions of Warp's kernels: one text for all scenes, what differs between them as `#if`.

- `scenes`: sets of compile options, and the shortest conditions for them.
- `source`: a device function's text, and what the names that it closes over are in each scene.
- `types`, `state`, `expressions`, `statements`, `function`: the parts of a function in C.
- `translator`: what kernels reach, each function once.
- `files`: which kernels, and into which files.

A device function is known by its code. A builder makes it once for each set of options, with other closures: a facet
says which value a name has in which scenes. Whatever has no translation raises `Unsupported`.
"""
