"""Folders of one file a frame that grow while they are read: the frames of all cameras, one after the other.

A frame is taken once every camera has its file. A camera is left out of it where it has later files already, or where its file
is not there, or not whole, some seconds after the first camera's. Frames go from the first to the last that two cameras have.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Event
from typing import NamedTuple

from poseppl.arrays import Floats
from poseppl.errors import FilePath, InputError
from poseppl.motion.io.json_people import frame_of_file
from poseppl.motion.io.keypoints import read_frame

POLL = 0.004
"""Seconds between two looks for the next file."""
_LISTING = 0.1
"""Seconds between two listings of a folder, at least; at most a tenth of the time goes into them."""


class KeypointFrame(NamedTuple):
    """What the cameras found in one frame.

    Attributes:
        number: Of the frame.
        people: Of each camera the people, each (K, 3): x, y, confidence; None where it has no file, or one that cannot be read.
        since: When the last of the files was there, by :func:`time.monotonic`.
    """

    number: int
    people: tuple[list[Floats] | None, ...]
    since: float


class _Folder:
    """One camera's files: those that came, and what was read of the next ones."""

    def __init__(self, name: str, folder: FilePath, detector: str | None) -> None:
        self.name, self._folder, self._detector = name, Path(folder), detector
        self.files: dict[int, Path] = {}
        self.came: dict[int, float] = {}
        self.people: dict[int, list[Floats] | None] = {}
        self.first = self.last = -1
        self.listed = -1
        """The last frame before the latest listing: what this did not find below will not come."""
        self._known: set[str] = set()
        self._looked, self._again = time.monotonic(), -float("inf")

    def look(self, now: float) -> None:
        """Find new files: that of the next number by its name, and now and then all."""
        while self.last >= 0 and (file := _following(self.files[self.last])) is not None and file.exists():
            self._add(file, now)
        if now >= self._again:
            self.listed, began = self.last, time.monotonic()
            with suppress(OSError):  # a folder that is gone for a while has no more files
                for file in self._folder.iterdir():
                    if file.suffix == ".json" and not file.name.startswith(".") and file.name not in self._known:
                        self._add(file, now)
            self._again = now + max(_LISTING, 10 * (time.monotonic() - began))
        self._looked = now

    def _add(self, file: Path, now: float) -> None:
        number = frame_of_file(file)
        if number in self.files:
            raise InputError(f"frame {number} is also {self.files[number].name}", file=file, expected="one file a frame")
        written = now
        with suppress(OSError):
            written = now - (time.time() - file.stat().st_mtime)
        self._known.add(file.name)
        self.files[number], self.came[number] = file, max(self._looked, min(now, written))
        self.first, self.last = number if self.first < 0 else min(self.first, number), max(self.last, number)

    def read(self, number: int) -> None:
        """Read the file of a frame.

        Raises:
            InputError: It is not whole, or not a detector's.
        """
        self.people[number] = read_frame(self.files[number], self._detector)


class GrowingFolders:
    """Folders of several cameras that a detector is writing to, one file a frame.

    Args:
        folders: By the names of the cameras.
        detector: What writes them, openpose or mmpose; found from their content if None.
        wait: Seconds that a camera may be later than the first one.
        idle: Seconds without a new frame after which there are no more; a camera that has none at all is waited for half as
            long.
        note: Who is told of what is missing.

    Raises:
        InputError: A folder is missing.
    """

    def __init__(
        self,
        folders: Mapping[str, FilePath],
        *,
        detector: str | None = None,
        wait: float = 1.0,
        idle: float = 10.0,
        note: Callable[[str], None] = lambda message: None,
    ) -> None:
        for name, folder in folders.items():
            if not Path(folder).is_dir():
                problem = "a file" if Path(folder).exists() else "no such folder"
                expected = "with --live a folder that a detector writes one JSON file a frame to, OpenPose or MMPose"
                raise InputError(problem, file=folder, field=name, expected=expected)
        self._folders = [_Folder(name, folder, detector) for name, folder in folders.items()]
        self._least = min(2, len(self._folders))
        self._wait, self._idle, self._note = wait, idle, note
        self._next: int | None = None
        self._begun: float | None = None
        self._absent: set[str] = set()

    def frames(self, stop: Event) -> Iterator[KeypointFrame]:
        """Frames as they come, until none has come for some seconds, or one is asked to stop."""
        last = time.monotonic()
        while not stop.is_set():
            frame = self.take(now := time.monotonic())
            if frame is not None:
                yield frame
                last = time.monotonic()
            elif now - last > self._idle:
                return
            else:
                stop.wait(POLL)

    def take(self, now: float) -> KeypointFrame | None:
        """The next frame; None where it cannot be taken yet.

        Raises:
            InputError: A file's name has no frame, or two files are of one.
        """
        for folder in self._folders:
            folder.look(now)
        self._next = number = self._first(now) if self._next is None else self._next
        if number is None or number > sorted(folder.last for folder in self._folders)[-self._least]:
            return None
        before = [folder for folder in self._folders if number not in folder.people]
        if not all([self._settled(folder, number, now) for folder in before]):  # all are tried
            return None
        people = tuple(folder.people.pop(number) for folder in self._folders)
        came = [folder.came[number] for folder, found in zip(self._folders, people, strict=True) if found is not None]
        self._next = number + 1
        return KeypointFrame(number, people, max(came, default=now))

    def _first(self, now: float) -> int | None:
        """The first frame that two cameras have, once all have one or were waited for."""
        firsts = sorted(folder.first for folder in self._folders if folder.last >= 0)
        if len(firsts) < self._least:
            return None
        self._begun = now if self._begun is None else self._begun
        whole = len(firsts) == len(self._folders) or now - self._begun > self._idle / 2
        return firsts[self._least - 1] if whole else None

    def _settled(self, folder: _Folder, number: int, now: float) -> bool:
        """Whether a camera's file was read, or will not be."""
        if number in folder.files:
            return self._read(folder, number, now)
        if number >= folder.listed and now - self._came(number) <= self._wait:
            return False
        if folder.name not in self._absent:
            self._absent.add(folder.name)
            self._note(f"{folder.name}: it has no file of frame {number}, and sees nobody until it has (--wait {self._wait:g})")
        folder.people[number] = None
        return True

    def _read(self, folder: _Folder, number: int, now: float) -> bool:
        try:
            folder.read(number)
            self._absent.discard(folder.name)
        except InputError as error:
            if now - folder.came[number] <= self._wait:
                return False
            self._note(f"{folder.name}: it sees nobody in frame {number}: {error}")
            folder.people[number] = None
        return True

    def _came(self, number: int) -> float:
        """When the first camera's file of a frame came; of a later one, where none has it."""
        came = [folder.came[number] for folder in self._folders if number in folder.came]
        later = (when for folder in self._folders for other, when in folder.came.items() if other > number)
        return min(came) if came else min(later)


def _following(file: Path) -> Path | None:
    """The file of the next frame, were it named alike."""
    parts = re.fullmatch("(.*?)([0-9]+)([^0-9]*)", file.stem)
    return file.with_stem(f"{parts[1]}{int(parts[2]) + 1:0{len(parts[2])}}{parts[3]}") if parts else None
