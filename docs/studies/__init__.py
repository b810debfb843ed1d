"""Studies: each module of ``thesis`` and ``beyond`` computes one table or figure of the documentation.

``study.py`` defines a study, ``catalogue.py`` finds all studies, ``page.py`` puts their results into
``docs/thesis.md`` and ``docs/beyond.md``, ``__main__.py`` is ``make studies``.
"""
