"""Cases: a mesh, the roles of its patches, a motion program and a method in one file, and playing it.

``case``             the case file, checked strictly
``motion_program``   where every moving node has to be after each step
``play``             drive a session through the case as a coupling code would
``records``          what a step has to say: quality, predictions, seconds
``outputs``          summary.json, points.npy, steps.csv and the VTU series, all or nothing
``picture``          quality.png: the mesh before and after, and the history
``check``            what is worth knowing before a case is played
``demo``             the thesis' cases, standard against corrected
"""
