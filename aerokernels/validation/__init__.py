"""Media whose rays are known, their exact rays, and the source paper's numbers.

    truth           rays of an index that is a formula, by SciPy's DOP853; shares nothing with the tracers
    closed_forms    where rays end in media with a closed solution
    cone            the shock cone that benchmark and work-precision measure on
    cone_rays       exact rays past a sharp cone
    report          tables, CSV and the style of figures in the docs
    paper           the source paper's tables and figures; `work_precision` errors against evaluations and time

The benchmark, the scripts and the tests use them; no other part of the package does.
"""
