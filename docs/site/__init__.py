"""The documentation site: ``python -m docs.site`` builds it from the Markdown pages of the repository.

The pages stay where they are and read well on a code host; what the site adds happens while it is built:
:mod:`.index` makes the navigation from ``docs/index.md``, :mod:`.reference` writes the pages' generated parts from the
code they are about, :mod:`.repository` turns links to source files into pages, :mod:`.links` checks every link of what
was built. ``conf.py`` puts these together for Sphinx.
"""
