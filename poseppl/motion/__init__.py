"""People in cameras: bodies, geometry, likelihoods, files of recordings, vision, rendering and tracking.

Each source has its settings, and :func:`track` takes them; all is loaded when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from poseppl.motion.keypoints.settings import KeypointSettings as KeypointSettings, LiveSettings as LiveSettings
    from poseppl.motion.points.settings import PointSettings as PointSettings
    from poseppl.motion.recordings.settings import (
        ObservationSettings as ObservationSettings,
        RecordingSettings as RecordingSettings,
    )
    from poseppl.motion.settings import TrackSettings as TrackSettings
    from poseppl.motion.silhouettes.settings import VideoSettings as VideoSettings

_HOMES = {
    "KeypointSettings": "keypoints.settings",
    "LiveSettings": "keypoints.settings",
    "ObservationSettings": "recordings.settings",
    "PointSettings": "points.settings",
    "RecordingSettings": "recordings.settings",
    "SmoothSettings": "tracking",
    "TrackSettings": "settings",
    "VideoSettings": "silhouettes.settings",
    "smooth": "tracking",
    "track": "sources",
}
"""The module of each name. Those that load bodies are not imported above, for bodies import packages of this one."""

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    return value
