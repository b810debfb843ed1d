"""The monitor page: shows a server's sessions in a browser, read-only, from a separate process.

- :mod:`.process`: the process; the supervisor starts it and reports every second which sessions have a worker;
- :mod:`.app`: the pages, protected by :mod:`.guard` and by the limits of :mod:`.connections`;
- :mod:`.live`: server-sent events; :mod:`.overview`, :mod:`.followed`, :mod:`.drawing`: the contents;
- ``static``: the page itself, plain HTML, CSS and modules; ``static/vendor``: the two drawing libraries.

It reads only the files of the state folder, so the page never delays a session.
"""
