"""The documentation site: ``python -m docs.site`` builds it from the Markdown pages of the repository.

The pages stay in their folders and are readable on a code host. The build of the site adds the rest:
:mod:`.index` makes the navigation from ``docs/index.md``, :mod:`.reference` writes the pages' generated parts from the
code that they describe, :mod:`.repository` turns links to source files into pages. ``conf.py`` puts these together for
Sphinx, which warns of every dead link.
"""
