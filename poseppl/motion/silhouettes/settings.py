"""Settings of videos: pictures, their cameras and backgrounds, and how silhouettes are found in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from poseppl.errors import Argument, FilePath, InputError, brief
from poseppl.files.frame_range import FrameRange
from poseppl.motion.settings import Axis, Builder, File, FileOrFolder, Frames, Rate, Settings, Stature, Within


@dataclass(frozen=True)
class VideoSettings(Settings):
    """Whose silhouettes are found in which videos.

    Attributes:
        videos: The videos, one a camera: FILE, named as the camera, or CAMERA=FILE; or a folder of videos of poseppl simulate,
            which has the calibration, the backgrounds and the truth, too.
        calibration: File of the calibrated cameras. Default: that of a scene's folder; videos need one.
        background: Pictures or clips of the empty scene, named as the cameras or CAMERA=FILE. Default: the background is
            learned from the videos.
        occlusion: Masks, white where furniture is that may hide the person, black elsewhere, named alike. Default: none.
        masks: Masks instead of a background, white on the person, named alike: a video, a folder of pictures, or .npz.
            Default: none.
        facing: Camera that the person faces at first, roughly; front and back look alike. Default: the direction of motion.
        silhouette_noise: Standard deviation of a silhouette's distances at the body, mm. Default: 80; with a prior 200.
        refine: Complete silhouettes by colour where the person looks like the background; about 40 ms per picture.
        edges: Count edges within the silhouettes, too.
        up: Axis of the calibration that points up. Default: Z.
        frames: Frames A:B, A to B - 1 of the videos, counted from 0. Default: all.
        rate: Frames a second. Default: what the videos say.
        stature: Height of the person, mm, whose segments are in proportion. Default: 1750, or that of the scene's truth.
        lengths: File of segment lengths that are known, mm: lines such as thigh = 435.0. Default: those of the stature.
        model: Body to track, package.module:builder or FILE.py:builder. Default: poseppl_models.bodies.silhouettes:full_body.
    """

    videos: tuple[FileOrFolder, ...]
    calibration: FileOrFolder | None = None
    background: tuple[FileOrFolder, ...] = ()
    occlusion: tuple[File, ...] = ()
    masks: tuple[FileOrFolder, ...] = ()
    facing: str | None = None
    silhouette_noise: Annotated[float, Within("a positive number of mm", lambda noise: 0 < noise < 1e4, "mm")] | None = None
    refine: bool = False
    edges: bool = False
    up: Axis | None = None
    frames: Frames | None = None
    rate: Rate | None = None
    stature: Stature | None = None
    lengths: File | None = None
    model: Builder | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.of_scene and self.calibration is None:
            raise InputError("no calibration", field=Argument("calibration"), expected="a file of the videos' cameras")
        for name in ("calibration", "up", "background", "occlusion", "masks") if self.of_scene else ():
            if getattr(self, name):
                problem = f"{self.videos[0]} has its own"
                raise InputError(problem, field=Argument(name), expected="none with a scene's folder")
        if FrameRange.parse(self.frames).step > 1:
            raise InputError(brief(self.frames), field=Argument("frames"), expected="A:B, frames A to B - 1 of the videos")

    @property
    def of_scene(self) -> bool:
        """Whether the videos are those of a rendered scene, of which the folder alone is given."""
        return is_scene(self.videos)


def is_scene(videos: Sequence[FilePath]) -> bool:
    """Whether videos are those of a rendered scene, of which the folder alone is given."""
    return len(videos) == 1 and "=" not in str(videos[0]) and (Path(videos[0]) / "scene.toml").is_file()
