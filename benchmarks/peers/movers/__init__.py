"""Movers written in Python: built from a task (set-up), then ``move(step)`` returns the positions (n, d)."""
