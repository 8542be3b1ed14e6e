"""A Kalman filter for one box: centre and size, each moving evenly, all with one covariance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoxFilter"]

# Standard deviations in heights of the first box, so that near and far objects are treated alike.
_MEASURED = 0.05  # of a detection
_FIRST_SPEED = 2.0  # heights a second: nothing is known of a new object's
_ACCELERATION = 1.0  # heights a second, gained in a second


class BoxFilter:
    """Constant velocity in seconds, so that frames may be missing.

    Noise is the same along all four axes, hence the covariance (2, 2) of value and rate is, too.

    Args:
        xyxy: (4,) the first box.
        time_s: when.
    """

    def __init__(self, xyxy: NDArray[np.float32], time_s: float) -> None:
        self._state = np.zeros((2, 4))  # values and rates of centre x, centre y, width, height
        self._state[0] = _centred(xyxy)
        unit = float(self._state[0, 3])
        self._measured = (_MEASURED * unit) ** 2
        self._drift = (_ACCELERATION * unit) ** 2
        self._covariance = np.diag([self._measured, (_FIRST_SPEED * unit) ** 2])
        self._time_s = time_s

    def predict(self, time_s: float) -> NDArray[np.float32]:
        """The box expected at a time: xyxy (4,); changes nothing."""
        x, y, width, height = (self._state[0] + (time_s - self._time_s) * self._state[1]).tolist()
        width, height = max(width, 1.0), max(height, 1.0)
        return np.array([x - width / 2, y - height / 2, x + width / 2, y + height / 2], np.float32)

    def correct(self, xyxy: NDArray[np.float32], time_s: float) -> None:
        """Takes in the box (4,) that was seen at a time."""
        step = time_s - self._time_s
        move = np.array([[1.0, step], [0.0, 1.0]])
        noise = self._drift * np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]])
        state, covariance = move @ self._state, move @ self._covariance @ move.T + noise
        gain = covariance[:, 0] / (covariance[0, 0] + self._measured)
        self._state = state + np.outer(gain, _centred(xyxy) - state[0])
        kept = np.eye(2) - np.outer(gain, [1.0, 0.0])
        self._covariance = kept @ covariance @ kept.T + self._measured * np.outer(gain, gain)  # Joseph's form
        self._time_s = time_s


def _centred(xyxy: NDArray[np.float32]) -> NDArray[np.float64]:
    left, top, right, bottom = np.asarray(xyxy, np.float64).tolist()
    return np.array([(left + right) / 2, (top + bottom) / 2, right - left, bottom - top])
