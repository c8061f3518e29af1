"""Pictures that are shifted exactly."""

from __future__ import annotations

import numpy as np


def shifted(image: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """Shifted by any part of a pixel, exactly, wrapping around the border: Fourier's shift theorem."""
    height, width = image.shape
    phase = np.exp(-2j * np.pi * (dx * np.fft.fftfreq(width) + dy * np.fft.fftfreq(height)[:, None]))
    moved = np.fft.ifft2(np.fft.fft2(image) * phase).real
    return np.clip(np.round(moved), 0, 255).astype(np.uint8)
