"""Reports: one page design for a run, a sweep, a series and a comparison, each a single HTML file without network.

`figures` describes a picture once, for the page's script and for paper; `air` and `front` are the pictures of a flow
and of a wavefront; `page` joins all in the template; the other modules say what a report of each job holds.
"""
