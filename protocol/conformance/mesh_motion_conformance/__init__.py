"""Does a server, or a client, do what SPEC.md says? The suite tests a black box, section by section.

It uses SPEC.md and nothing else: not the server, not its codec. Modules, from the document to the verdict:
:mod:`.spec_tables` reads SPEC.md's tables into ``tables.json``, which :mod:`.tables` holds; :mod:`.wire` reads and
writes frames, :mod:`.show` makes them readable, :mod:`.line` is one connection with an end to every wait;
:mod:`.case` is one demand, :mod:`.checks` what every reply has to be, :mod:`.runner` runs cases and :mod:`.report`
prints. :mod:`.server` has the cases for servers, by section; :mod:`.client` a scripted server for clients.
"""
