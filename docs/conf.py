"""Sphinx: `sphinx-build -W docs docs/_build/html`, with `-t quick` without the runs of the gallery."""

import sys
from pathlib import Path

import discsim

sys.path.insert(0, str(Path(__file__).parent))

project = "discsim"
author = copyright = "the discsim developers"
version = release = discsim.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "pages"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off" if "quick" in tags else "force"  # noqa: F821 - of Sphinx
nb_execution_timeout = 900  # of one cell, where kernels compile
nb_execution_raise_on_error = True
nb_execution_in_temp = True  # the runs of notebooks stay out of the sources
exclude_patterns = ["_build", "_generated"]
highlight_language = "text"
smartquotes = False
nitpicky = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "ndarray"}

html_theme = "furo"
html_title = f"discsim {release}"
html_static_path = ["_static"]
html_css_files = ["discsim.css"]
html_show_sphinx = False
html_theme_options = {"top_of_page_buttons": []}
