"""Smoothers: one algorithm a file, each a pure function from a filter's history to smoothed states."""

from poseppl.smoothers.base import History as History
from poseppl.smoothers.base import Smoothed as Smoothed
from poseppl.smoothers.base import Smoother as Smoother
from poseppl.smoothers.base import SmoothingInfo as SmoothingInfo
from poseppl.smoothers.base import collect_history as collect_history
