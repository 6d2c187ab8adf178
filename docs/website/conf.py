"""Sphinx's settings. Sources are the tree that `website.tree` assembles; nothing is fetched, now or when a page is read."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "models"), str(ROOT / "papers"), str(ROOT / "docs")]

project = "poseppl"
version = release = version_of("poseppl")
author = copyright = "the poseppl authors"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "website.aliases",
    "website.docstrings",
    "website.mathml",
    "website.notebooks",
    "website.source_pages",
]
source_suffix = {".md": "myst-nb", ".rst": "restructuredtext"}
exclude_patterns = ["README.md"]
default_role = "code"

html_theme = "furo"
html_math_renderer = "mathml"
html_title = f"poseppl {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False

nb_custom_formats = {".py": "website.notebooks.read"}
nb_execution_mode = os.environ.get("POSEPPL_SITE_NOTEBOOKS", "cache")  # cache, force or off
nb_execution_cache_path = os.environ.get("POSEPPL_SITE_CACHE", "")
nb_execution_timeout = -1
nb_execution_raise_on_error = True
nb_execution_excludepatterns = ["*.md"]
nb_output_stderr = "remove"
nb_merge_streams = True

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4

viewcode_follow_imported_members = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
