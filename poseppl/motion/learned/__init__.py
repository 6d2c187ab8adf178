"""Activities learned from recordings: principal components of angles with a hidden Markov model, and tables of bins.

Trained once and kept in a file of its own; :mod:`poseppl_models.bodies.learned_motion` and
:mod:`poseppl_models.peursum.factored_system` make programs of them.
"""

from poseppl.motion.learned.factored_tables import (
    FactoredTables as FactoredTables,
    bin_angles as bin_angles,
    read_factored_tables as read_factored_tables,
    root_places as root_places,
    train_factored_motion as train_factored_motion,
    write_factored_tables as write_factored_tables,
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
