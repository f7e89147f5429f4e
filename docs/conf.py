"""Sphinx configuration: the Markdown pages of this folder as a site, theme Furo."""

from __future__ import annotations

project = 'flex_payload'
copyright = 'flex_payload maintainers, Apache-2.0'  # noqa: A001
extensions = ['myst_parser', 'sphinx.ext.mathjax']
html_theme = 'furo'
html_title = 'flex_payload'
html_show_sphinx = False
html_static_path = ['_static']
html_css_files = ['wide.css']
myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 3
# Tables of the field's own marks, and shell blocks with placeholders, are no program text.
suppress_warnings = ['misc.highlighting_failure', 'myst.header']
exclude_patterns = ['figures']
