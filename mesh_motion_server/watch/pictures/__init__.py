"""Pictures for papers: the history of runs, and a mesh before and after, coloured by quality.

:mod:`.palette` has the colours that all pictures share and :mod:`.page` has the size, fonts
and file of a figure. :mod:`.history` draws a :class:`~.runs.Run`, from any kind of folder; :mod:`.mesh_axes` and
:mod:`.before_after` draw a :class:`~.snapshot.Snapshot`. matplotlib is an extra (``plot``)
and imported when something is drawn.
"""
