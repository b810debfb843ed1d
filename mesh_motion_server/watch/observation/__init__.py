"""Read sessions from their folders alone: no request goes to a worker, so no worker is delayed.

- :mod:`.follow`: a session's events as they are written;
- :mod:`.series`: columns by step, thinned to what a chart shows;
- :mod:`.sessions`: the sessions of a state folder and their states.

Everything is read only; a live session's files may be read at any moment.
"""
