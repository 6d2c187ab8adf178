"""Small valid files of every format, as text or bytes."""

from __future__ import annotations

import struct

import numpy as np

ASF = """# a leg
:version 1.10
:name leg
:units
  mass 1.0
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name femur
     direction 0.6 -0.8 0
     length 7.5
     axis 0 0 20  XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-inf inf)
  end
  begin
     id 2
     name tibia
     direction 0 -1 0
     length 7
     axis 10 0 20 XYZ
    dof rx
    limits (-10.0 170.0)
  end
  begin
     id 3
     name foot
     direction 0 0 1
     length 2
     axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root femur
    femur tibia
    tibia foot
  end
"""

AMC = """#!OML:ASF
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 10 20 30
femur 5 -6 7
tibia 40
2
root 1.5 2 3 10 20 30
femur 5 -6 7e0
tibia 41
"""

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT Knee
  {
    OFFSET 2.0 -80.0 0
    CHANNELS 3 Zrotation Yrotation Xrotation
    End Site
    {
      OFFSET 0 -80.0 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
0 100 0 10 20 30 1 2 3
1 100 0 10 20 30 1 2 4
"""

CSV = """frame,marker,x,y,camera,confidence
3,hip,10.5,20,left,1
3,knee,11,30.25,left,0.5
3,hip,12,21,right,1
5,knee,13,31,right,0.75
"""

TOML = """units = "mm"

[camera.front]
size = [1920, 1080]
matrix = [[1500.0, 0.0, 960.0], [0.0, 1500.0, 540.0], [0.0, 0.0, 1.0]]
distortion = [0.1, -0.05, 0.001, 0.0, 0.0]
rotation = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
translation = [0.0, 1000.0, 5000.0]
"""


def c3d_bytes(
    points: np.ndarray,
    labels: list[str],
    *,
    units: str = "mm",
    vertical: str = "+Z",
    rate: float = 100.0,
    angles: tuple[str, ...] = (),
    order: str = "intel",
    scale: float = -1.0,
) -> bytes:
    """A C3D file of (T, K, 3) points, NaN where unseen, after the manual; whole numbers where ``scale`` is positive."""
    frames, count = points.shape[:2]
    ends = ">" if order == "mips" else "<"

    def real(*values: float) -> bytes:
        if order == "dec":  # VAX: four times as large in IEEE's form, the halves exchanged
            return (np.array(values) * 4).astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
        return np.array(values, ends + "f4").tobytes()

    def whole(*values: int) -> bytes:
        return np.array(values, ends + "i2").tobytes()

    def text(values: list[str]) -> tuple[int, tuple[int, ...], bytes]:
        width = max(map(len, values))
        return -1, (width, len(values)), "".join(value.ljust(width) for value in values).encode()

    values = {
        "USED": (2, (), whole(count)),
        "FRAMES": (2, (), whole(frames)),
        "SCALE": (4, (), real(scale)),
        "RATE": (4, (), real(rate)),
        "DATA_START": (2, (), whole(4)),
        "UNITS": text([units]),
        "X_SCREEN": text(["+X"]),
        "Y_SCREEN": text([vertical]),
        "LABELS": text(labels),
    }
    if angles:
        values["ANGLES"] = text(list(angles))
    section = struct.pack("<bb5s", 5, -1, b"POINT") + whole(3) + b"\0"
    for name, (kind, dimensions, data) in values.items():
        body = struct.pack("<bB", kind, len(dimensions)) + bytes(dimensions) + data + b"\0"
        section += struct.pack("<bb", len(name), 1) + name.encode() + whole(len(body) + 2) + body
    section = (bytes([1, 80, 2, {"intel": 84, "dec": 85, "mips": 86}[order]]) + section).ljust(1024, b"\0")
    header = bytes([2, 80]) + whole(count, 0, 1, frames, 0) + real(scale) + whole(4, 0) + real(rate)
    seen = np.isfinite(points).all(axis=-1)
    data = np.concatenate([np.nan_to_num(points), np.where(seen, 0.0, -1.0)[..., None]], axis=-1)
    data[..., :3] /= scale if scale > 0 else 1.0
    stored = whole(*np.rint(data).astype(int).ravel()) if scale > 0 else real(*data.ravel())
    return header.ljust(512, b"\0") + section + stored.ljust(512, b"\0")


MOT = (
    "Coordinates\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\n\nUnits are S.I. units (second, meters, Newtons, ...)\n"
    "endheader\ntime\tknee_angle_r\tpelvis_tx\n0.00\t12.5\t0.31\n0.02\t13.5\t0.32\n"
)

TRC = (
    "PathFileType\t4\t(X/Y/Z)\twalk.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "50\t50\t2\t2\tcm\t50\t1\t2\n"
    "Frame#\tTime\tC7\t\t\tL.ASIS\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "\n"
    "1\t0.0\t10\t20\t30\t40\t50\t60\n"
    "2\t0.02\t11\t21\t31\t\t51\t61\n"
)
EXPONENTIAL_SKELETON = '{"parent": [-1, 0, 1], "offset": [[0, 0, 0], [1, 0, 0], [0, -8, 0]]}'
EXPONENTIAL_MAPS = "0,16,0,0,0,0,0,0,1.57079633,0,0,0\n1,16,0,0,1.57079633,0,0,0,0,0,0,0\n"


CHARACTER = """{"Skeleton": {"Joints": [
 {"Name": "root", "Type": "none", "Parent": -1, "AttachX": 0, "AttachY": 0, "AttachZ": 0},
 {"Name": "hip", "Type": "spherical", "Parent": 0, "AttachX": 0, "AttachY": 0, "AttachZ": 0.1},
 {"Name": "knee", "Type": "revolute", "Parent": 1, "AttachX": 0, "AttachY": -0.4, "AttachZ": 0},
 {"Name": "ankle", "Type": "fixed", "Parent": 2, "AttachX": 0, "AttachY": -0.5, "AttachZ": 0}
]}}"""
CLIP = """{"Loop": "wrap", "Frames": [
 [0.5, 0, 1, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0],
 [0.5, 1, 1, 0, 0.70710678, 0, 0.70710678, 0, 0.70710678, 0, 0, 0.70710678, -1.57079633],
 [0, 2, 1, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0]
]}"""

DEEPLABCUT = """scorer,net,net,net,net,net,net
bodyparts,knee,knee,knee,foot,foot,foot
coords,x,y,likelihood,x,y,likelihood
0,1.5,2.5,0.9,3.5,4.5,0.8
1,,,1.0,nan,NaN,1.0
2,1.5,2.25,0.5,5,6,0.25
"""

CALISCOPE = """sync_index,cam_id,object_id,keypoint_id,img_loc_x,img_loc_y,frame_time
3,0,0,0,577.25,305.5,0.5
3,0,0,1,563.5,227.75,0.5
3,1,0,0,549.75,151.0,0.5
4,1,0,1,643.125,295.5,0.75
"""

MEDIAPIPE = """frame,timestamp,landmark,x,y,visibility
0,0.0,nose,0.5,0.25,0.9
0,0.0,11,0.5,0.25,0.9
1,0.02,nose,0.5,,0.9
1,0.02,left_hip,0.75,0.25,0.9
"""

YAML = """%YAML:1.0
---
image_width: 1088
image_height: 1920
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1680.5, 0., 532.25, 0., 1681.25, 948.5, 0.,
       0., 1. ]
D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, -0.2, 0., 0., 0.05 ]
rvec: [ 1.5, -0.5, 0.25 ]
tvec: [ 0.5, 1., 3. ]
names:
   - "1"
   - "2"
"""
