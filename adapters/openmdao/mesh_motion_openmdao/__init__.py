"""Mesh motion for OpenMDAO: :mod:`.component` has the component, named as MPhys names a mesh warper."""
