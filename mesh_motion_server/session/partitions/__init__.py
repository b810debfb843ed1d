"""The mesh of a session in the parts that its partitions send, and the one mesh made of them.

::

    uploads.py           the mesh during the upload
    meshes.py            a partition's mesh, the merged mesh, and the way back from one to the other
    merging.py           n partitions as one mesh in canonical order
    numbering.py         the mesh in the numbering of its senders, for messages
"""
