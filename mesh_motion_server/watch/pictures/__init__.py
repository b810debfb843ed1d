"""Pictures for papers: the history of runs, and a mesh before and after, coloured by quality.

:mod:`.palette` has the colours that all pictures share and :mod:`.page` what makes a figure fit a page: its size, fonts
and file. A :class:`~.runs.Run` is what :mod:`.history` draws, whichever folder it came from; a
:class:`~.snapshot.Snapshot` is what :mod:`.mesh_axes` and :mod:`.before_after` draw. matplotlib is an extra (``plot``)
and imported when something is drawn.
"""
