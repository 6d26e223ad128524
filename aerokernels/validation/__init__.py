"""Media whose rays are known, their exact rays, random cases for tests, and the source paper's numbers.

    truth           rays of an index that is a formula, by SciPy's DOP853; shares nothing with the tracers
    closed_forms    where rays end in media with a closed solution
    cone            the shock cone that benchmark and work-precision measure on
    bundle_draws    random bundles through random fields; `bundle_check` compares them with the reference engine
    wave_draws      random views through shocks and turbulence, for the verdict on ray optics
    cone_rays       exact rays past a sharp cone
    scene_draws     random scenes with difficult features; `scene_check` compares their budgets with the truth
    report          tables, CSV and the style of figures in the docs
    paper           the source paper's tables and figures; `work_precision` errors against evaluations and time

The benchmark, the scripts and the tests use them; no other part of the package does.
"""
