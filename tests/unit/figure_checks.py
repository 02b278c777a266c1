"""What every published figure is held to."""

from accelerated_evaluation.publishing.figures.style import FORMATS, save_figure


def check_bytes_and_legend(draw, name, folder):
    """The same tables give the same bytes, and the legend covers no data."""
    for one in ("one", "two"):
        figure, data = draw(name)
        assert figure.get_supxlabel() == "Data: made up"
        save_figure(figure, data, folder / one, name)
    (legend,) = figure.legends
    assert not any(legend.get_window_extent().overlaps(axes.get_window_extent()) for axes in figure.axes)
    for ending in (*FORMATS, "csv"):
        one, two = ((folder / part / f"{name}.{ending}").read_bytes() for part in ("one", "two"))
        assert one == two, ending
