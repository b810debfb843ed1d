"""Sessions watched from a terminal: ``mesh-motion monitor``.

A :class:`~.sources.Source` says which sessions there are and what is known of one of them: :mod:`.folder_source` from
the folders of a server alone, :mod:`.endpoint_source` by asking a server. :mod:`.recording` takes a session's history
in, :mod:`.panels` and :mod:`.chart` turn it into lines of text of a given size, which :mod:`.snapshot` prints once and
:mod:`.app` shows live, with Textual (extra ``monitor``).
"""
