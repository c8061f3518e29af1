"""Places of printed dots to a hundredth of a pixel, by matching each with its image at rest.

The centre of a dot's darkness depends on its outline alone, so noise moves it more than it must. Here each dot is
compared with its image at rest in all pixels about it, by inverse compositional Gauss-Newton steps (Baker
and Matthews 2004), so that only its position, brightness and contrast may differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float, Float32

ROUNDS = 2
"""Steps from the centre of darkness. A third one hardly moves any dot but those that a hard contact deforms."""


@dataclass(frozen=True)
class DotImages:
    """Each dot's image at rest, and the matrix that turns a difference from it into a motion.

    `alike` spans the differences that motion, brightness, contrast and blur cause, in orthonormal images.
    """

    reach: int
    rest: Float32[np.ndarray, 'dots pixels']
    step: Float32[np.ndarray, 'dots 2 pixels']
    alike: Float32[np.ndarray, 'dots pixels 5']

    @classmethod
    def of(
        cls, height: Float32[np.ndarray, 'h w'], centres_px: Float[np.ndarray, 'dots 2'], diameter_px: float
    ) -> DotImages:
        """The images of dots in a picture of their contrast, within three quarters of a diameter of their centres."""
        reach = int(np.ceil(0.75 * diameter_px))
        wider = sampled(height, centres_px, reach + 1)
        rest, along_x = wider[:, 1:-1, 1:-1], (wider[:, 1:-1, 2:] - wider[:, 1:-1, :-2]) / 2
        along_y = (wider[:, 2:, 1:-1] - wider[:, :-2, 1:-1]) / 2
        beside = wider[:, 1:-1, 2:] + wider[:, 1:-1, :-2] + wider[:, 2:, 1:-1] + wider[:, :-2, 1:-1]
        ways = np.stack([along_x, along_y, rest, np.ones_like(rest), beside], -1).reshape(len(rest), -1, 5)
        step = np.linalg.pinv(ways[..., :4])[:, :2]
        return cls(reach, rest.reshape(len(rest), -1), step, np.linalg.qr(ways)[0])

    def matched(
        self, height: Float32[np.ndarray, 'h w'], centres_px: Float[np.ndarray, 'dots 2']
    ) -> tuple[Float[np.ndarray, 'dots 2'], Float[np.ndarray, ' dots']]:
        """The places of the dots, from the centres of their darkness, and the standard deviation of each along an axis.

        What is left of a dot's difference from its image at rest is noise of its pixels.
        """
        places, off = centres_px, np.zeros_like(self.rest)
        for _ in range(ROUNDS):
            off = sampled(height, places, self.reach).reshape(self.rest.shape) - self.rest
            places = places - np.einsum('dip,dp->di', self.step, off)
        explained = np.square(np.einsum('dpk,dp->dk', self.alike, off)).sum(axis=1)
        noise = np.sqrt(np.maximum(np.square(off).sum(axis=1) - explained, 0.0) / off.shape[1])
        return places, noise * np.sqrt(np.square(self.step).sum(axis=2).mean(axis=1))


def sampled(
    height: Float32[np.ndarray, 'h w'], places: Float[np.ndarray, 'n 2'], reach: int
) -> Float32[np.ndarray, 'n side side']:
    """Squares of a picture about places, by cubic interpolation (Keys 1981); beyond its rim as at the rim."""
    low = np.floor(places).astype(int)
    steps, side = np.arange(-reach - 1, reach + 3), 2 * reach + 1
    cols, rows = (
        np.clip(low[:, axis, None] + steps, 0, height.shape[1 - axis] - 1) for axis in (0, 1)
    )  # fmt: skip
    pixels = height[rows[:, :, None], cols[:, None, :]]
    right, down = (_cubic(part).astype(np.float32) for part in (places - low).T)
    across = sum(right[:, k, None, None] * pixels[:, :, k : k + side] for k in range(4))
    squares: np.ndarray = sum(down[:, k, None, None] * across[:, k : k + side] for k in range(4))
    return squares


def _cubic(part: Float[np.ndarray, ' n']) -> Float[np.ndarray, 'n 4']:
    """Weights of the pixels at -1, 0, 1 and 2."""
    t, t2, t3 = part, part**2, part**3
    return np.stack([2 * t2 - t - t3, 2 - 5 * t2 + 3 * t3, t + 4 * t2 - 3 * t3, t3 - t2], -1) / 2
