"""Views of sessions: reading their folders, the monitor page, the terminal, pictures."""
