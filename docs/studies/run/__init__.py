"""Tables and figures of docs/run.md: ten periods of a motion, as in a coupled run."""
