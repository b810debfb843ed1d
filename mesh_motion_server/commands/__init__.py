"""The command line: one module a command; :mod:`.app` joins them, :mod:`.cli` runs them and has the exit statuses."""
