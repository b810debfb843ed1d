"""Tables and figures of docs/run.md: ten periods of a motion, as a coupled run takes them."""
