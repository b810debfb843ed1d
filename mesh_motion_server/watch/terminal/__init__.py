"""Sessions shown on a terminal: ``mesh-motion inspect --follow``.

:mod:`.sources` reads the sessions, from the folders of a server; :mod:`.table` shows them once as a table, as text
or as JSON; :mod:`.live` repeats this.
"""
