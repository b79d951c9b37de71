"""Pages of the site that are made when it is built (``make docs``): from declarations, records and docstrings.

A maker is a module with ``pages() -> dict``: address in the site -> text, or bytes of a picture. `hook` hands them to
MkDocs. What takes more than a moment is kept in build/site-cache until a source changes (`cache`).
"""
