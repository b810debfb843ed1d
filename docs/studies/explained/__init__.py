"""Figures of docs/explained.md: what happens between the displacements that come in and those that go out."""
