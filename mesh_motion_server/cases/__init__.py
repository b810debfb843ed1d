"""Cases: a mesh, the roles of its patches, a motion program and a method in one file, and how to play it.

``case``             the case file, checked strictly
``motion_program``   the position of every moving node after each step
``play``             drive a session through the case as a coupling code would
``results``, ``records``  the results of a run so far; the record of each step: quality, predictions, seconds
``outputs``          summary.json, points.npy, steps.csv and the VTU series, all or nothing
``check``            warnings, estimates and predictions before a case is played
``demo``             the cases of the thesis, standard and corrected
"""
