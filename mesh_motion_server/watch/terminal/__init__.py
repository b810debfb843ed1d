"""Sessions watched from a terminal: ``mesh-motion monitor``.

:mod:`.sources` reads the sessions, from the folders of a server or by asking it; :mod:`.table` shows one look at them
as a table, as text and as JSON; :mod:`.live` repeats that.
"""
