"""Media whose rays are known, what the rays do in them, random cases for fuzzing, and the source paper's numbers.

    truth           rays of an index that is a formula, by SciPy's DOP853; shares nothing with the tracers
    closed_forms    where rays end in media with a closed solution
    cone            the shock cone that benchmark and work-precision measure on
    bundle_draws    random bundles through random fields; `bundle_check` holds them against the reference engine
    wave_draws      random views through shocks and turbulence, for the verdict on ray optics
    cone_rays       exact rays past a sharp cone
    scene_draws     random scenes full of traps; `scene_check` holds their budgets against the truth
    report          tables, CSV and the look of pictures in the docs
    paper           the source paper's tables and figures; `work_precision` errors against evaluations and time

The benchmark, the scripts and the tests use them; nothing else of the package does.
"""
