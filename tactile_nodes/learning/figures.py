"""Figures without a screen, if matplotlib is installed. Errors in writing them are reported in a sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactile_nodes.errors import ConfigurationError, DatasetError, from_extra
from tactile_nodes.paths import check_output


def figure(width_in: float, height_in: float) -> Any:
    """An empty matplotlib figure.

    Raises:
        ConfigurationError: matplotlib is not installed.
    """
    with from_extra('train', 'drawing'):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    drawn = Figure(figsize=(width_in, height_in), layout='constrained')
    FigureCanvasAgg(drawn)
    return drawn


def save(drawn: Any, file: Path, dpi: int = 120) -> None:
    """Write a figure. The file's extension selects the image format.

    Raises:
        ConfigurationError: the extension is no image format, or no file can be written there.
        DatasetError: the file cannot be written.
    """
    if not file.suffix:
        raise ConfigurationError(f'cannot draw {file}: its name must end in .png, .pdf or .svg')
    check_output(file)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        drawn.savefig(file, dpi=dpi)
    except ValueError as error:
        raise ConfigurationError(f'cannot draw {file}: {error}') from error
    except OSError as error:
        raise DatasetError(f'cannot write the figure {file} ({error.strerror}); choose another place') from error
