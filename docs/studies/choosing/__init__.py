"""Tables and figures of docs/choosing.md: the support radius and the quality threshold on the examples."""
