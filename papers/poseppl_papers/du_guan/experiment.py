"""The experiment: its parts, and what its page says of it."""

from __future__ import annotations

from functools import partial

from poseppl_papers.du_guan.claims import claims, mueller, noise, scales, sequences, trackers
from poseppl_papers.du_guan.mueller import mueller_table
from poseppl_papers.du_guan.plan import FULL, QUICK, plan_mueller, plan_noise, plan_scales, plan_sequences, plan_trackers
from poseppl_papers.experiment import Experiment, Part
from poseppl_papers.images.tables import ERRORS_ARE, drawn_errors, tracked

_SETTING = f"""\
Du and Guan, "Monocular Human Motion Tracking with the DE-MC Particle Filter", 2006. {ERRORS_ARE} One camera; "weight" \
is the average sample weight, the mean likelihood of a frame's particles. "Velocity" is the paper's prediction, a \
constant velocity; "transition" draws from the random walk, the default of `demc_filter`. A frame fails where no \
particle finds its way back."""
_DEPARTURES = """\
- The recording and the room are ours, and the diffusion is half of the walk's largest changes between frames, of the \
poses closest to the truth: the paper does not tell its own.
- Evaluations count the first population, too, so that particles are fewer than the paper's 1,750, 700 and 500.
- Sequences are 1.3 s each: a walk, for the paper's first, a jump and a run. There is no hop: the recordings have none.
- Resampling is systematic. The scales of colours and boundaries (0.3), which the paper does not give, are ours; the \
part "scales" changes each by a factor of 3. A velocity that leads all particles beyond the joints' limits is not taken.
- The noise of Eq. 6 is U(-c sigma, c sigma), times the survival diagnostic of Eq. 7. The paper calls c "a small number \
which can be flexibly chosen", gives Eq. 7 without its constant, and contradicts it in its text. Filters without a \
remark have c = 0.1, Eq. 7 as printed over N, and as sigma the particles' standard deviations. The part "noise" compares \
twelve settings on walks of two other people; "chosen noise" is the setting of the least absolute error there: c = 0.3, \
the largest that was tried, Eq. 7 as printed, and the standard deviations of the random walk.
- A sequence is followed if the error in place and the error relative to the pelvis are both at least a tenth lower than \
those of a tracker that holds the first pose. Intervals are over runs on one recording, so that they say nothing of \
other recordings.
- The temperature of Mueller's surface is ours; the paper does not tell it."""

EXPERIMENT = Experiment(
    name="du-guan-2006",
    title="Du and Guan 2006, run again",
    setting=_SETTING,
    departures=_DEPARTURES,
    full=FULL,
    quick=QUICK,
    parts={
        "trackers": Part(
            "average weights of DE-MC, CONDENSATION and the annealed filter (Figs. 4 and 5)",
            plan_trackers,
            partial(tracked, "trackers"),
            partial(drawn_errors, "trackers"),
        ),
        "sequences": Part(
            "a walk by 7 layers of 500, and other motion by 9 of 600 (Fig. 3)",
            plan_sequences,
            partial(tracked, "sequences"),
            all_recordings=True,
        ),
        "scales": Part(
            "the walk with the scales of the three cues changed",
            plan_scales,
            partial(tracked, "scales"),
        ),
        "noise": Part(
            "the noise of Eqs. 6 and 7 on walks that are not among the sequences",
            plan_noise,
            partial(tracked, "noise"),
            runs=lambda scale: int(scale.noise_runs),
            all_recordings=True,
        ),
        "mueller": Part(
            "who finds the basins of Mueller's surface (Fig. 2b)",
            plan_mueller,
            mueller_table,
            runs=lambda scale: int(scale.surface_runs),
            seen="Mueller's surface",
        ),
    },
    claims=claims,
    sections={
        "Filters on a walk": trackers,
        "Sequences": sequences,
        "Scales of the cues": scales,
        "Noise": noise,
        "Mueller's surface": mueller,
    },
    pictures={"trackers.png": "Errors of the filters"},
)
