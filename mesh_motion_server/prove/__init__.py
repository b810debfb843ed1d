"""What shows from outside that a server keeps its promises: attacks with a seed and a count, for tests and proofs."""
