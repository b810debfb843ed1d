"""The mesh: cells, facets, patches and roles, periodic pairs, sliding surfaces, layers on walls."""
