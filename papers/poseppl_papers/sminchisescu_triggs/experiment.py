"""The experiment: its parts, and what its page says of it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from poseppl_papers.experiment import Experiment, Part, Tables
from poseppl_papers.sminchisescu_triggs.claims import BODIES_ARE, SCENES, claims
from poseppl_papers.sminchisescu_triggs.one_picture import sizes_table
from poseppl_papers.sminchisescu_triggs.plan import (
    FULL,
    QUICK,
    plan_arm,
    plan_clavicles,
    plan_complex,
    plan_pictures,
    plan_pivot,
    plan_reflections,
    plan_sizes,
    plan_spectra,
)
from poseppl_papers.sminchisescu_triggs.spectra import draw_spectra, modes_found, spectra_table
from poseppl_papers.sminchisescu_triggs.survival import LOSSES, losses, runs_table
from poseppl_papers.tables import markdown

_SETTING = (
    "One camera at 4.5 m, focal length 1,000 px, sees the joints as points with noise of 3 px; in a cluttered room a tenth of "
    "them are up to 80 px astray. The walk has 100 mm and 1 rad a root of a second. A body is lost when its markers are more "
    "than 150 mm from the truth on the mean, relative to the root, for 0.2 s; a run ends there. Rendered frames have 640 x 480 "
    "px, at 3 m, and are tracked by the image cost of section 3.1 at two levels of a pyramid, from a person that is not the "
    "tracker's own body."
)
_DEPARTURES = """\
- Points stand in for images but in the part `pictures`: the image cost takes too long for a dozen runs of each tracker.
- Scenes are ours, with truth: programs of the joints that differ from run to run, and recordings. The paper has one of each.
- "Limbs along the optical axis" are eight programs and three recordings, one run of each. The camera looks along the \
direction in which hands and feet move most. Each program takes limbs through the image plane, where towards and away look \
alike, to a pose whose mirror image breaks a joint limit or runs through the trunk.
- Rivals "with large noise" scatter by ten times the walk's covariance: as far as covariance scaled sampling along a direction \
that is as uncertain. CONDENSATION has 2,000 particles, which take as long as the published tracker's climbs.
- The prior over time is part of what is climbed; the paper's is static, and weighs what was found.
- MHT in its first form has no joint limits, nor has the tracker named so; all others have. Parts keep apart on the arm and \
where limbs are along the optical axis, but for a tracker that is named "without non-penetration", and on the other bodies \
where one is named "with non-penetration". The potential counts the 24 nearest pairs of parts, and of their nodes the 128 \
nearest.
- The optical flow is OpenCV's DIS, with an outlier map from flow forth and back. The paper's is Black and Anandan's robust \
flow.
- "Assumed density" is not theirs but ours, the default of `poseppl track`, on the same points, without joint limits or with \
smooth ones. Parts do not keep apart in it, but for the arm's and along the optical axis. "Kinematic jumps" start every second \
climb from a limb that leans the other way, as their paper of 2003 has it.
- On complex motions the published tracker and the Gaussian one have 36 runs at the first rate: 12 left open which is better.
- Starts are the modes, and four for each direction (section 4.2 gives no number).
- Clavicles are judged on stretches of 2 s of recordings, one after the other. The recordings given are of one person who \
jumps, punches, and bends to scoop something up. The joints of the shoulders are among the points that are seen.
- Modes of a pose are those that climbs from 4,000 draws of the prior end in, or climbs from any of the starts compared. \
The body is that of Choo and Fleet, with 28 coordinates. Points are seen, without clutter. The paper counts no modes.
- Spectra are those of points without errors, at the true pose. Sizes are estimated from marked joints; contours can be added \
(`poseppl_models.sminchisescu_triggs.sizes`)."""


def _modes(tables: Tables) -> str:
    found = modes_found(tables)
    about = (
        "Cells are percentages of the modes and of their mass, with the evaluations of likelihood, gradient and curvature in "
        "brackets; means over poses. The command is `python -m studies.modes_found`."
    )
    return found and f"{about}\n\n{found}"


def _section(name: str, tables: Tables) -> str:
    return markdown(LOSSES, losses(tables[name])) if name in tables else ""


PARTS: Mapping[str, Part] = {
    "arm": Part("an arm that bends and rotates, points", plan_arm, partial(runs_table, "arm"), seen="own programs"),
    "pivot": Part("a pivoting body, points", plan_pivot, partial(runs_table, "pivot"), seen="own programs"),
    "complex": Part("complex motions, points", plan_complex, partial(runs_table, "complex"), all_recordings=True),
    "reflections": Part(
        "limbs along the optical axis, points",
        plan_reflections,
        partial(runs_table, "reflections"),
        all_recordings=True,
    ),
    "clavicles": Part(
        "recorded motions with and without clavicles, points",
        plan_clavicles,
        partial(runs_table, "clavicles", label=lambda job: BODIES_ARE[job.kind]),
        all_recordings=True,
    ),
    "spectra": Part(
        "how uncertain a pose is along each direction", plan_spectra, spectra_table, draw_spectra, seen="own programs"
    ),
    "sizes": Part("a person's sizes from one picture", plan_sizes, sizes_table, seen="people drawn from the prior"),
    "pictures": Part(
        "a rendered arm, image cost",
        plan_pictures,
        partial(runs_table, "pictures"),
        runs=lambda scale: int(scale.picture_runs),
        seen="own programs",
    ),
}

EXPERIMENT = Experiment(
    name="sminchisescu-triggs-2001",
    title="Sminchisescu and Triggs 2001, run again",
    setting=_SETTING,
    departures=_DEPARTURES,
    full=FULL,
    quick=QUICK,
    parts=PARTS,
    claims=claims,
    pictures={"spectra.png": "Spectra of poses (Fig. 3)", "modes_found.png": "Shares of a pose's modes against evaluations"},
    sections={
        **{f"Time to loss: {title}": partial(_section, name) for name, title in SCENES.items()},
        "Time to loss: with and without clavicles": partial(_section, "clavicles"),
        "Modes of a pose, by where climbs start": _modes,
    },
)
