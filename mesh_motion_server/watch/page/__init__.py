"""The monitor page: shows a server's sessions in a browser, read-only, from a separate process.

- :mod:`.process`: the process; the supervisor starts it and reports every second which sessions have a worker;
- :mod:`.app`: the pages, protected by :mod:`.guard` and by the limits of :mod:`.connections`;
- :mod:`.archive`: the answers, from :mod:`.overview`, :mod:`.followed` and :mod:`.drawing`;
- ``static``: the page itself, plain HTML, CSS and modules; ``static/vendor``: the library of its charts.

It reads only the files of the state folder, so the page never delays a session.
"""
