"""What people see of sessions, from their folders alone: nothing is asked of a worker, so that nothing holds one up.

- :mod:`.follow`: a session's events as they come;
- :mod:`.series`: columns by step, thinned to what a chart shows;
- :mod:`.sessions`: the sessions of a state folder and where they stand.

Everything is read only; a live session's files may be read at any moment.
"""
