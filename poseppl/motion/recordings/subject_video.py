"""Videos of a subject in a room, with the truth: the folder that ``poseppl simulate`` writes."""

from __future__ import annotations

from typing import Any

from poseppl.errors import FilePath
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.recordings.truth import save_subject_truth
from poseppl.motion.rendering import Setting, Truth, write_scene


def film_subject(folder: FilePath, subject: MovingSubject, setting: Setting, **options: Any) -> None:
    """Render a subject in a setting that was built around its motion, and write the folder.

    Args:
        folder: The folder, which does not exist yet.
        subject: Whose truth is written.
        setting: The rendered scene.
        options: Noise, lossless and advance, as :func:`poseppl.motion.rendering.write_scene` takes them.

    Raises:
        InputError: The folder exists or cannot be made, or an option is out of range.
        PosepplError: A package or OpenGL is missing, or the disk is full.
    """
    truth = Truth(subject.frames, subject.rate, subject.body.tree.marker_names, subject.markers, subject.source)
    write_scene(folder, setting, truth, besides=lambda place: save_subject_truth(subject, place / "truth.nc"), **options)
