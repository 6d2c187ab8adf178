"""Outputs of a run on the command line: the result first, wherever there is room for it, and then its pictures."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from poseppl.errors import PosepplError

_SHARED_MEMORY = Path("/dev/shm")


def keep_result(tree: Any, target: Path) -> None:
    """Write a result; if its place fails, such as a full disk, in another folder.

    Args:
        tree: The result.
        target: Its file.

    Raises:
        PosepplError: The result is elsewhere, or nowhere; says where, and what to do.
    """
    from poseppl.runs.results import save_result

    try:
        save_result(tree, target)
    except (PosepplError, OSError) as error:
        kept = _kept_elsewhere(tree, target.name)
        if kept is None:
            problem = f"{error}; nor was there room in {', '.join(map(str, _shelters()))}"
            advice = "free some space and run it again; with --checkpoint, finished frames are not computed again"
            raise PosepplError(f"{problem}. The result is lost: {advice}") from error
        raise PosepplError(f"{error}. The result is in {kept}: move it from there") from error


def _kept_elsewhere(tree: Any, name: str) -> Path | None:
    from poseppl.runs.results import save_result

    for shelter in _shelters():
        with suppress(PosepplError, OSError):
            folder = Path(tempfile.mkdtemp(prefix="poseppl-", dir=shelter))
            try:
                save_result(tree, folder / name)
            except BaseException:
                folder.rmdir()
                raise
            return folder / name
    return None


def _shelters() -> Iterator[Path]:
    """Folders that may be on other disks."""
    with suppress(OSError):  # there is no folder for temporary files, or it is full
        yield Path(tempfile.gettempdir())
    with suppress(RuntimeError):
        yield Path.home()
    if _SHARED_MEMORY.is_dir():
        yield _SHARED_MEMORY


def draw(path: Path, write: Callable[[], Any], note: Callable[[str], None]) -> bool:
    """Draw a picture of a result that is written; a failure is reported, and costs nothing.

    Args:
        path: The picture, for the note.
        write: Draws and writes it.
        note: Receives a message about a failure.

    Returns:
        Whether it was drawn.
    """
    try:
        write()
    except Exception as error:
        note(f"{path}: not drawn, but the result is written: {error}")
        return False
    return True


def write_outputs(tree: Any, target: Path, note: Callable[[str], None]) -> list[tuple[str, Path]]:
    """Write a result, then its picture.

    Args:
        tree: The result.
        target: Its file; the picture's has the suffix .png.
        note: Receives a message about a picture that could not be drawn.

    Returns:
        The outputs, and their files.

    Raises:
        PosepplError: The result is not at its place; says where it is.
    """
    from poseppl.report import plot_track, save_picture

    keep_result(tree, target)
    picture = target.with_suffix(".png")
    drawn = draw(picture, lambda: save_picture(plot_track(tree), picture), note)
    return [("result", target), *([("picture", picture)] if drawn else [])]


def summary(tree: Any) -> list[tuple[str, str]]:
    """The rows of the table."""
    from poseppl.motion.tracking import measure_run
    from poseppl.runs.contents import FLAT
    from poseppl.runs.results import provenance

    numbers, known = measure_run(tree), provenance(tree)
    sizes = tree[FLAT].sizes
    residual = known.get("residual_mm")

    def shown(value: float | None, pattern: str) -> str | None:
        return None if value is None else pattern.format(value)

    rows = [
        ("input", str(known["input"])),
        ("model", f"{known['model'].rpartition(':')[2]}, {sizes['state_dim']} coordinates"),
        ("filter", known.get("filter")),
        ("smoother", known.get("smoother")),
        ("frames", f"{sizes['frame']}" + (f", {numbers.failed} impossible" if numbers.failed else "")),
        ("body's distance from the recording", shown(residual, "{:.1f} mm")),
        ("mean joint error", shown(numbers.joint_error, "{:.1f} mm")),
        ("  relative to the pelvis", shown(numbers.joint_error_relative, "{:.1f} mm")),
        ("coverage of 90 % intervals, joints", shown(numbers.coverage, "{:.1%}")),
        ("  of the coordinates", shown(numbers.coverage_state, "{:.1%}")),
        ("rejection rate", shown(numbers.rejection, "{:.1%}")),
        ("inefficiency factor, median", shown(numbers.tau, "{:.1f}")),
        ("  mean", shown(numbers.tau_mean, "{:.1f}")),
        ("frames a second", shown(numbers.frames_per_second, "{:.1f}")),
        ("compilation", shown(known["compile_seconds"] or None, "{:.1f} s")),
    ]
    return [(name, value) for name, value in rows if value is not None]
