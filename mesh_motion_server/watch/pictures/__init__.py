"""Pictures for papers: the history of runs, and a mesh before and after, coloured by quality.

:mod:`.palette` has the colours that all pictures share and :mod:`.page` has the size, fonts and file of a figure.
:mod:`.runs` and :mod:`.meshes` read sessions and played cases; :mod:`.history` draws a :class:`~.runs.Run`,
:mod:`.before_after` a mesh at two times. matplotlib is an extra (``plot``) and imported when something is drawn.
"""
