"""Motion capture, 2-D observations, calibrations and video: from files to arrays, lengths in mm with Z up, and back."""

from __future__ import annotations

from poseppl.files.frame_range import FrameRange as FrameRange
from poseppl.motion.io.c3d import write_c3d as write_c3d
from poseppl.motion.io.cameras import (
    Calibration as Calibration,
    CameraRecord as CameraRecord,
    read_calibration as read_calibration,
    read_cameras as read_cameras,
    write_cameras as write_cameras,
)
from poseppl.motion.io.detections import DetectedPeople as DetectedPeople
from poseppl.motion.io.keypoints import read_keypoints as read_keypoints
from poseppl.motion.io.masks import open_masks as open_masks, read_masks as read_masks
from poseppl.motion.io.motion import Motion as Motion, resample as resample, slice_frames as slice_frames
from poseppl.motion.io.names import read_names as read_names
from poseppl.motion.io.observations import (
    Observations as Observations,
    read_observations as read_observations,
    read_places as read_places,
    write_observations as write_observations,
    write_places as write_places,
)
from poseppl.motion.io.opencv import read_image as read_image, write_image as write_image
from poseppl.motion.io.opensim_files import read_mot as read_mot, write_mot as write_mot
from poseppl.motion.io.recording import read_motion as read_motion
from poseppl.motion.io.synchronised import VideoWarning as VideoWarning, synchronised as synchronised
from poseppl.motion.io.trc import write_trc as write_trc
from poseppl.motion.io.video import Video as Video, open_video as open_video
from poseppl.motion.io.video_writing import video_writer as video_writer, write_video as write_video
