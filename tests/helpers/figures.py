"""Readability of the figures in reports."""

import itertools

_TOUCHING = 1.0  # overlap that can't be seen [pixels]


def assert_readable(figure):
    """Assert that nothing is cut off, panels, legends and ticks don't overlap, and axis labels name
    a unit.
    """
    figure.draw_without_rendering()
    around = figure.get_tightbbox()  # [in]
    width, height = figure.get_size_inches()
    assert 0 <= around.x0 < around.x1 <= width
    assert 0 <= around.y0 < around.y1 <= height
    panels = [axes for axes in figure.axes if axes.get_visible() and axes.axison]
    legends = [axes.get_legend() for axes in figure.axes if not axes.axison and axes.get_legend()]
    parts = (*panels, *legends, *figure.legends)
    boxes = [part.get_tightbbox().padded(-_TOUCHING) for part in parts]
    assert not _collide(*boxes)
    for axes in panels:
        assert not _collide(*(text.get_window_extent() for text in _ticks(axes)))
    labels = [text for axes in panels for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
    assert all("[" in text for text in labels), labels
    return figure


def _collide(*boxes):
    return any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def _ticks(axes):
    low, high = sorted(axes.get_xlim())
    texts = [*axes.get_xticklabels(), *axes.get_xticklabels(minor=True)]
    return [
        text
        for text in texts
        if text.get_visible() and text.get_text() and low <= text.get_position()[0] <= high
    ]
