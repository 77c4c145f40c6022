"""Sphinx configuration of the documentation site: `make docs` builds it into out/docs."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))
from generate import codes, command_line, configuration, metrics

project = "truerate"
author = copyright = "truerate maintainers"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx-mathjax-offline"]
man_pages = [("reference/command-line", "truerate", "corrected rates of wearable IMUs", [author], 1)]
html_theme = "furo"
html_title = "truerate"
html_extra_path = ["card"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 60
autodoc_typehints = "description"
autodoc_member_order = "bysource"
# Links out of docs/ lead to files of the repository, which the site does not carry.
suppress_warnings = ["myst.xref_missing"]


def setup(app: Sphinx) -> None:
    """Write the generated reference pages before Sphinx reads its sources."""
    folder = Path(app.srcdir) / "reference"
    (folder / "command-line.md").write_text(command_line(), encoding="utf-8")
    (folder / "codes.md").write_text(codes(), encoding="utf-8")
    (folder / "configuration.md").write_text(configuration(), encoding="utf-8")
    (folder / "metrics.md").write_text(metrics(), encoding="utf-8")
