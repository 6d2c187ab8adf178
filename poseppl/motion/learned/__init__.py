"""Activities learned from recordings: principal components of angles with a hidden Markov model, and tables of bins.

Trained once and kept in a file of its own; :mod:`poseppl_models.bodies.learned_motion` and
:mod:`poseppl_models.bodies.factored_motion` make programs of them.
"""

from poseppl.motion.learned.factored_motion import (
    FactoredMotion as FactoredMotion,
    learn_factored_motion as learn_factored_motion,
    read_factored_motion as read_factored_motion,
    read_learned_motion as read_learned_motion,
    write_factored_motion as write_factored_motion,
)
from poseppl.motion.learned.factored_tables import (
    FactoredTables as FactoredTables,
    bin_angles as bin_angles,
    root_places as root_places,
    train_factored_motion as train_factored_motion,
)
from poseppl.motion.learned.motion_model import (
    MotionModel as MotionModel,
    read_motion_model as read_motion_model,
    write_motion_model as write_motion_model,
)
from poseppl.motion.learned.posed_recordings import (
    PosedRecording as PosedRecording,
    Recording as Recording,
    common_rate as common_rate,
    frames_between as frames_between,
    pose_recording as pose_recording,
    read_recording as read_recording,
)
from poseppl.motion.learned.training import TrainingSettings as TrainingSettings, train_motion_model as train_motion_model
