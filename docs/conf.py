"""Sphinx: how these pages become a site. `scripts/docs` builds it; AEROKERNELS_DOCS_EXECUTE=off runs no code."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

import aerokernels  # noqa: E402

execute = os.environ.get("AEROKERNELS_DOCS_EXECUTE", "on") != "off"

project = "aerokernels"
author = "the authors of aerokernels"
copyright = "the authors of aerokernels, Apache License 2.0"
release = version = aerokernels.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "sphinx_design",
    "sphinx_copybutton",
    "cover_pictures",
    "generated_pages",
    "mathml",
    "plain_docstrings",
    "whole_numbers",
]
exclude_patterns = [
    "_ext",
    "questions/*.md",
    "**/table.md",
    "**/tables.md",
    "examples/*",
    "gallery/*.ipynb",
    "sg_execution_times.rst",
]
suppress_warnings = [
    "config.cache",
    "toc.empty_glob",
    *([] if execute else ["myst-nb.lexer"]),
]  # the kernel that runs tells the language

# Pages
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist", "attrs_inline"]
myst_heading_anchors = 3
nb_execution_mode = "force" if execute else "off"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_merge_streams = True
nb_execution_show_tb = True
copybutton_exclude = ".linenos, .gp, .go"

# Examples with pictures
sphinx_gallery_conf = {
    "examples_dirs": [str(HERE / "examples")],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"plot_" if execute else r"nothing_is_run",
    "plot_gallery": execute,
    "download_all_examples": False,
    "show_memory": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "abort_on_example_error": True,
    "remove_config_comments": True,
    "show_signature": False,
    "within_subsection_order": "FileNameSortKey",
}

# Docstrings: Google's sections, prose with single backticks for code
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_typehints_format = "short"
autodoc_class_signature = "mixed"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

# Site
html_theme = "pydata_sphinx_theme"
html_title = "aerokernels"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_sidebars = {"conventions": []}  # it has no pages under it
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "aerokernels"},
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "show_nav_level": 1,
    "header_links_before_dropdown": 6,
    "header_dropdown_text": "More",
    "navbar_align": "left",
    "navbar_persistent": [],
    "navbar_end": ["search-button-field", "theme-switcher"],
    "article_footer_items": [],
    "footer_start": ["copyright"],
    "footer_center": [],
    "footer_end": ["sphinx-version"],
    "secondary_sidebar_items": ["page-toc"],
}
html_math_renderer = "mathml"
toc_object_entries_show_parents = "hide"
