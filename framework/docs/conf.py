"""Sphinx configuration of the documentation site, which is made of the pages of the project and of its docstrings.

Sphinx reads the pages where they stand, so that their links are the same on the site: the root of the project is the
source folder, this folder the one of the configuration. From the root::

    python -m sphinx -W --keep-going -n -b html -c framework/docs . build/site

A broken link, a reference to nothing and a public name without a page are warnings, and ``-W`` makes them errors.
"""

from sphinx.util.logging import getLogger
from sphinx.util.nodes import make_refnode

import percuss
import percuss.testing

LOGGER = getLogger(__name__)

project = "percuss"
author = "The percuss authors"
version = release = percuss.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.mathjax", "numpydoc"]
root_doc = "README"
include_patterns = ["README.md", "cases/**.md", "plugins/**.md", "framework/*.md", "framework/docs/**.md", "tests/*.md"]
exclude_patterns = ["**/.*", "build", "dist"]

myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
suppress_warnings = ["myst.header"]  # a page may begin a section two levels below the last one

default_role = "autolink"  # a name in single backticks is a link if it is a public name, and is in italics if not
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings give types and shapes in the words of the field
autosummary_generate = False
numpydoc_show_class_members = False
nitpicky = True

html_theme = "furo"
html_title = f"percuss {version}"
html_additional_pages = {"index": "index.html"}
html_show_copyright = False
html_show_sourcelink = False
templates_path = ["templates"]

# The pages in the order of the site's menu; a page that is missing here is a warning of Sphinx.
PYTHON = ["run", "contact_laws", "frictions", "pairings", "integrators", "loads", "bodies", "solutions", "options"]
PYTHON += ["errors", "testing"]
MENU = {
    "Use percuss": [
        *("cases/TEN_MINUTES", "cases/README", "cases/GALLERY", "cases/RUNS", "cases/SOLIDS", "cases/STUDIES"),
        *("cases/studies/README", "cases/studies/RESULTS", "cases/studies/SOLIDS", "cases/REFERENCE"),
    ],
    "Methods": [f"plugins/{name}" for name in ("README", "CHOOSE", "STABILITY", "REFERENCE")],
    "Write a method": [
        f"plugins/{name}"
        for name in ("CONTACT_LAW", "INTEGRATOR", "FRICTION", "LOAD", "BODY", "SOLID", "MEASURE", "PACKAGE")
    ],
    "Inside percuss": [
        *(f"framework/{name}" for name in ("README", "THEORY", "INSIDE", "GLOSSARY", "CONTRIBUTING", "CHANGES")),
        "tests/README",
    ],
    "Python": [f"framework/docs/api/{name}" for name in PYTHON],
}


def with_menu(app, page, source):
    """Add the menu of the site to its first page, which is also the README and shows no menu there."""
    if page == root_doc:
        for caption, pages in MENU.items():
            source[0] += "\n```{toctree}\n:hidden:\n:caption: " + caption + "\n\n" + "\n".join(pages) + "\n```\n"


def check_public_names(app, environment):
    """Warn of each public name that no page of the site describes."""
    described = environment.get_domain("py").objects
    for module in (percuss, percuss.testing):
        for name in module.__all__:
            if f"{module.__name__}.{name}" not in described:
                LOGGER.warning("no page in framework/docs/api describes %s.%s", module.__name__, name)


def link_to_class(app, environment, node, content):
    """Return a link to the class of an attribute that only the docstring of this class describes, and else plain text.

    This is for names in single backticks alone: every other reference to nothing stays a warning.
    """
    if node.get("reftype") != "obj":
        return None
    owner = node["reftarget"].rpartition(".")[0]
    named = [owner, *(f"{module.__name__}.{owner}" for module in (percuss, percuss.testing))]
    domain = environment.get_domain("py")
    found = next((domain.objects[name] for name in named if owner and name in domain.objects), None)
    if found is None:
        return content
    return make_refnode(app.builder, node["refdoc"], found.docname, found.node_id, content, owner)


def setup(app):
    """Register the menu and the check of public names."""
    app.connect("source-read", with_menu)
    app.connect("missing-reference", link_to_class)
    app.connect("env-check-consistency", check_public_names)
    return {"parallel_read_safe": True}
