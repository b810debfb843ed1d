"""The cases for servers: one module or more a section of SPEC.md, in its order."""
