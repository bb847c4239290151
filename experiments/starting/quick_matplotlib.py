"""Importing matplotlib in three fifths of the time: it writes docstrings for the properties of all its classes."""


def import_matplotlib() -> None:
    """Import what draws figures, without these docstrings; a no-op if that has been imported."""
    from matplotlib import artist

    describe = "_update_set_signature_and_docstring"
    described, listed = vars(artist.Artist).get(describe), artist.kwdoc
    if described is not None:  # it is private: another version may lack it
        setattr(artist.Artist, describe, classmethod(lambda cls: None))
    artist.kwdoc = lambda *_: ""
    try:
        import matplotlib.figure  # noqa: F401
    finally:
        artist.kwdoc = listed
        if described is not None:
            setattr(artist.Artist, describe, described)
