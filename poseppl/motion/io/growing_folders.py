"""Folders of one file a frame that grow while they are read: the frames of all cameras, one after the other.

A frame is taken once every camera has its file. A camera is left out of it where it has later files already, or where its file
is not there, or not whole, some seconds after the first camera's. Frames go from the first to the last that two cameras have.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Event
from typing import NamedTuple

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, Location, Phrase
from poseppl.motion.io.json_people import frame_number
from poseppl.motion.io.keypoints import read_frame

POLL = 0.004
"""Seconds between two looks for the next file."""
_LISTING = 0.1
"""Seconds between two listings of a folder, and from a new file to a listing, at least; at most a tenth of the time goes into
listings."""
_LAST_NUMBER = re.compile(r"([0-9]+)[^0-9]*[.]json$")


class KeypointFrame(NamedTuple):
    """Detections of the cameras in one frame.

    Attributes:
        number: Number of the frame.
        people: For each camera the people, each (K, 3): x, y, confidence; None if it has no readable file.
        since: When the last of the files was there, by :func:`time.monotonic`.
    """

    number: int
    people: tuple[list[Floats] | None, ...]
    since: float


class _File(NamedTuple):
    """A file that was found, and when it came."""

    path: Path
    came: float


class _Folder:
    """One camera's files that were not taken yet, and what was read of the next one.

    A detector names its files alike, so that the next one is looked for by its name, which costs the same however many there
    are. All are listed before the first one, and where one is late or named otherwise.
    """

    def __init__(self, name: str, folder: FilePath, detector: str | None) -> None:
        self.name, self.path, self._detector = name, Path(folder), detector
        self.files: dict[int, _File] = {}
        self.people: dict[int, list[Floats] | None] = {}
        self.last = self.listed = -1
        """The last frame; and the last one before the latest listing, below which what this did not find will not come."""
        self._expected: Path | None = None
        self._looked = time.monotonic()
        self._newest = self._next_listing = -float("inf")

    def look(self, now: float, wanted: int | None) -> None:
        """Find new files from a wanted frame on, or all: by their names, and by a listing where they are late."""
        while self._expected is not None and (came := self._came(self._expected, now)) is not None:
            self._add(self.last + 1, _File(self._expected, came))
            self._newest = now
        passed = wanted is not None and self.listed <= wanted < self.last and wanted not in self.files
        if now >= self._next_listing and (passed or now >= self._newest + _LISTING):
            began, self.listed = time.monotonic(), self.last
            for number, file in self._unknown(wanted or 0):
                self._add(number, _File(file, self._came(file, now) or now))
            self._next_listing = now + max(_LISTING, 10 * (time.monotonic() - began))
        self._looked = now

    def _unknown(self, wanted: int) -> list[tuple[int, Path]]:
        """Files of a listing that are not known, from a wanted frame on, in order."""
        known, found = {file.path.name for file in self.files.values()}, []
        with suppress(OSError), os.scandir(self.path) as entries:  # a folder that is gone for a while has no more files
            for name in (entry.name for entry in entries):
                if name.endswith(".json") and not name.startswith(".") and name not in known:
                    number = _LAST_NUMBER.search(name)  # of each file of an hour: no path is made of one that was taken
                    if number is None or int(number[1]) >= wanted:
                        found.append((frame_number(name, Location(file := self.path / name)), file))
        return sorted(found)

    def _came(self, file: Path, now: float) -> float | None:
        """When a file came, after the last look; None where it is not there."""
        try:
            written = now - (time.time() - file.stat().st_mtime)
        except OSError:
            return None
        return max(self._looked, min(now, written))

    def _add(self, number: int, file: _File) -> None:
        if number in self.files:
            problem = f"frame {number} is also {self.files[number].path.name}"
            raise Location(file.path).error(problem, "one file a frame")
        self.files[number] = file
        if number > self.last:
            self.last, self._expected = number, _following(file.path)

    def take(self, number: int) -> tuple[list[Floats] | None, float | None]:
        """The people of a frame, and when its file came, None where there is none; it is forgotten."""
        people, file = self.people.pop(number), self.files.pop(number, None)
        return people, None if people is None or file is None else file.came

    def read(self, number: int) -> None:
        """Read the file of a frame.

        Raises:
            InputError: It is not whole, or not a detector's.
        """
        self.people[number] = read_frame(self.files[number].path, self._detector)


class GrowingFolders:
    """Folders of several cameras that a detector is writing to, one file a frame.

    Args:
        folders: By the names of the cameras.
        detector: Program that writes them, openpose or mmpose; detected from their content if None.
        wait: Seconds that a camera may be later than the first one.
        idle: Seconds without a new frame after which there are no more; a camera that has none at all is waited for half as
            long.
        note: Receives a message about what is missing.

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
                expected = "a folder that a detector writes one JSON file a frame to, OpenPose or MMPose"
                raise Location(folder, field=name).error(problem, expected)
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
                self._tell_missing()
                return
            else:
                stop.wait(POLL)

    def _tell_missing(self) -> None:
        """Tell of folders that are gone, and of files that were not taken since too few cameras have their frames."""
        last = max(folder.last for folder in self._folders)
        for folder in self._folders:
            if not folder.path.is_dir():
                self._note(f"{folder.name}: {folder.path} is gone")
            elif self._next is not None and folder.last < self._next <= last:
                self._note(f"{folder.name}: no file from frame {self._next} on; too few other cameras have it for positions")

    def take(self, now: float) -> KeypointFrame | None:
        """The next frame; None where it cannot be taken yet.

        Raises:
            InputError: A file's name has no frame, or two files are of one.
        """
        for folder in self._folders:
            folder.look(now, self._next)
        number = self._first(now) if self._next is None else self._next
        if number is None or number > sorted(folder.last for folder in self._folders)[-self._least]:
            return None
        before = [folder for folder in self._folders if number not in folder.people]
        if not all([self._settled(folder, number, now) for folder in before]):  # all are tried
            return None
        people, came = zip(*(folder.take(number) for folder in self._folders), strict=True)
        self._next = number + 1
        return KeypointFrame(number, people, max((when for when in came if when is not None), default=now))

    def _first(self, now: float) -> int | None:
        """The first frame that two cameras have, once all have one or were waited for; those before it are forgotten."""
        firsts = sorted(min(folder.files) for folder in self._folders if folder.files)
        if len(firsts) < self._least:
            return None
        self._begun = now if self._begun is None else self._begun
        if len(firsts) < len(self._folders) and now - self._begun <= self._idle / 2:
            return None
        self._next = first = firsts[self._least - 1]
        for folder in self._folders:
            folder.files = {number: file for number, file in folder.files.items() if number >= first}
        return first

    def _settled(self, folder: _Folder, number: int, now: float) -> bool:
        """Whether a camera's file was read, or will not be."""
        if number in folder.files:
            return self._read(folder, number, now)
        if number >= folder.listed and now - self._came(number) <= self._wait:
            return False
        if folder.name not in self._absent:
            self._absent.add(folder.name)
            lacks = "it has no file" if folder.path.is_dir() else f"{folder.path} is gone, it has no file"
            missing = f"{folder.name}: {lacks} of frame {number}, and sees nobody until it has ("
            self._note(Phrase(missing, Argument("wait", self._wait), ")"))
        folder.people[number] = None
        return True

    def _read(self, folder: _Folder, number: int, now: float) -> bool:
        try:
            folder.read(number)
            self._absent.discard(folder.name)
        except InputError as error:
            if now - folder.files[number].came <= self._wait:
                return False
            self._note(Phrase(f"{folder.name}: it sees nobody in frame {number}: ", error.message))
            folder.people[number] = None
        return True

    def _came(self, number: int) -> float:
        """When the first camera's file of a frame came; of a later one, where none has it."""
        came = [folder.files[number].came for folder in self._folders if number in folder.files]
        return min(came or (next(iter(folder.files.values())).came for folder in self._folders if folder.files))


def _following(file: Path) -> Path | None:
    """The file of the next frame, were it named alike."""
    parts = re.fullmatch("(.*?)([0-9]+)([^0-9]*)", file.stem)
    return file.with_stem(f"{parts[1]}{int(parts[2]) + 1:0{len(parts[2])}}{parts[3]}") if parts else None
