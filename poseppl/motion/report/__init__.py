"""Pictures and sections of a report for results with a body; :func:`poseppl.report.write_report` includes the sections."""

from __future__ import annotations

import xarray as xr

from poseppl.diagnostics.modes import modes_over_time
from poseppl.motion.report.figures import (
    draw_track as draw_track,
    plot_error as plot_error,
    plot_overlay as plot_overlay,
    plot_pose3d as plot_pose3d,
)
from poseppl.motion.report.pose_views import doubts_shown, ghosts, pose_data
from poseppl.motion.report.sections import (
    camera_table,
    cards,
    doubt_table,
    error_table,
    error_traces,
    joint_charts,
    residual_chart,
)
from poseppl.motion.verdicts.doubts import doubts_of
from poseppl.motion.verdicts.residuals import image_errors
from poseppl.report.chart import chart
from poseppl.report.page import Extension
from poseppl.runs.contents import draws_of


def extension(tree: xr.DataTree) -> Extension:
    """Collect what a body adds to the report of a diagnosed result."""
    modes = None if draws_of(tree, "markers") is None else modes_over_time(tree, of="markers")
    poses, doubts, errors = pose_data(tree), doubts_of(tree), image_errors(tree)
    if poses is not None and poses["space"] is not None:
        poses["space"]["ghosts"] = None if modes is None else ghosts(modes, poses["frames"])
        poses["space"]["doubts"] = doubts_shown(tree, doubts, poses["frames"])
    charts = {"error": chart(error_traces(tree), "mm"), "residuals": residual_chart(tree, errors), "joints": joint_charts(tree)}
    return Extension(
        __name__,
        cards=cards(tree),
        charts=charts,
        data={"pose-data": poses},
        content={
            "poses": poses,
            "num_frames": tree["posterior"].sizes["frame"],
            "errors": error_table(tree),
            "cameras": camera_table(tree, errors),
            "doubted": doubt_table(tree, doubts),
            "doubts": doubts,
        },
        modes=modes,
    )
