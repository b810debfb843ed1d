"""Reads sessions from their folders alone: no request goes to a worker, so no worker is delayed.

- :mod:`.follow`: a session's events as they are written;
- :mod:`.series`: columns by step, thinned to what a chart shows; :mod:`.steps`: the events of one step;
- :mod:`.followed`, :mod:`.reading`: one session, its history read in pieces;
- :mod:`.sessions`, :mod:`.overview`: the sessions of a state folder, with :mod:`.verdict`'s one line on each.

Everything is read only; a live session's files may be read at any moment.
"""
