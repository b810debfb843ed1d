"""Looking at sessions: what their folders say, the page, the terminal, pictures."""
