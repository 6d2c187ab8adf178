"""The recording of a man on a beam, as the command line's options name it."""

from __future__ import annotations

from pathlib import Path


def words(data_dir: Path, *cameras: int, source: str = "keypoints") -> list[str]:
    """The command of a source, and the keypoints of some cameras, with their calibration and rate."""
    folder = data_dir / "pose2sim_balancing"
    found = [f"cam_0{c}={folder / 'pose' / f'cam0{c}_json'}" for c in cameras]
    calibration = str(folder / "calibration" / "Calib_qualisys.toml")
    return [*source.split(), *found, "--calibration", calibration, "--rate", "60"]
