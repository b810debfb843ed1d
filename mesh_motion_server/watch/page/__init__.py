"""The monitor page: what people see of a server's sessions in a browser, read-only, from a process of its own.

- :mod:`.process`: started by the supervisor, told every second which sessions have a worker;
- :mod:`.app`: the pages, behind :mod:`.guard` and on :mod:`.connections` with a bound on everything;
- :mod:`.live`: server-sent events; :mod:`.overview`, :mod:`.followed`, :mod:`.drawing`: what they and the page say;
- ``static``: the page itself, plain HTML, CSS and modules; ``static/vendor``: the two libraries that it is drawn with.

It reads the state folder's files and asks nobody: whatever is done to it, no session waits.
"""
