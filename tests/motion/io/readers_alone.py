"""What ezc3d and pybvh do with damaged files by themselves, beside what the checks before them say; prints counts.

python tests/motion/io/readers_alone.py
"""

from __future__ import annotations

import collections
import os
import pickle
import resource
import signal
import sys
import tempfile
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import ezc3d
import numpy as np
import pybvh
from hypothesis import HealthCheck, given, settings
from test_fuzz_readers import BVH, C3D, damaged, damaged_bytes

from poseppl.errors import PosepplError
from poseppl.motion.io.bvh import _check_text
from poseppl.motion.io.c3d_layout import check_layout


def read_by_ezc3d(path):
    points = np.asarray(ezc3d.c3d(str(path))["data"]["points"])
    return points.shape, points[:3].tobytes()


def read_by_pybvh(path):
    clip = pybvh.read_bvh_file(path, world_up="auto", warn_on_world_up_disagreement=False)
    arrays = np.asarray(clip.rest_pose_positions()), np.asarray(clip.joint_angles)
    return [array.shape for array in arrays], [array.tobytes() for array in arrays]


def outcome(read, path):
    """What reading does in a process of its own with 4 GiB and 10 s of a processor."""
    receiver, sender = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        for kind, bound in ((resource.RLIMIT_CPU, 10), (resource.RLIMIT_AS, 4 * 2**30), (resource.RLIMIT_CORE, 0)):
            resource.setrlimit(kind, (bound, bound))
        try:
            told = read(path)
        except Exception:
            told = "refused"
        os.write(sender, pickle.dumps(told))
        os._exit(0)
    os.close(sender)
    with open(receiver, "rb") as stream:
        told = stream.read()
    status = os.waitpid(child, 0)[1]
    return signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else pickle.loads(told)


def report(name, whole, copies, check, read):
    path, counts = Path(tempfile.mkdtemp()) / f"file.{name}", collections.Counter()
    path.write_bytes(whole)
    expected = outcome(read, path)

    @settings(max_examples=400, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(copies)
    def count(copy):
        path.write_bytes(copy if isinstance(copy, bytes) else copy.encode("utf-8", "surrogatepass"))
        try:
            check(path, copy)
            said = "accepted"
        except PosepplError:
            said = "refused"
        found = outcome(read, path)
        if not isinstance(found, str):
            same_shape, same = found[0] == expected[0], found == expected
            found = "as undamaged" if same else "other values" if same_shape else "other shapes"
        counts[f"{name}: {said} by our check, alone: {found}"] += 1

    count()
    for line, number in sorted(counts.items()):
        print(f"{number:4d}  {line}")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    report("c3d", C3D, damaged_bytes(C3D), lambda path, copy: check_layout(path), read_by_ezc3d)
    report("bvh", BVH.encode(), damaged(BVH), _check_text, read_by_pybvh)
