"""Diagnostics of a result: mixing, degeneracy, calibration, and what they mean in words."""

from poseppl.diagnostics.autocorrelation import autocorrelation as autocorrelation
from poseppl.diagnostics.calibration import LEVELS as LEVELS
from poseppl.diagnostics.calibration import Coverage as Coverage
from poseppl.diagnostics.calibration import JointError as JointError
from poseppl.diagnostics.calibration import coverage as coverage
from poseppl.diagnostics.calibration import inside_interval as inside_interval
from poseppl.diagnostics.calibration import joint_error as joint_error
from poseppl.diagnostics.calibration import probability_transform as probability_transform
from poseppl.diagnostics.comparison import compare as compare
from poseppl.diagnostics.comparison import comparison_table as comparison_table
from poseppl.diagnostics.diagnosis import diagnose as diagnose
from poseppl.diagnostics.diagnosis import root_index as root_index
from poseppl.diagnostics.inefficiency import Mixing as Mixing
from poseppl.diagnostics.inefficiency import inefficiency as inefficiency
from poseppl.diagnostics.inefficiency import mixing as mixing
from poseppl.diagnostics.inefficiency import split_rhat as split_rhat
from poseppl.diagnostics.inefficiency import windowed_inefficiency as windowed_inefficiency
from poseppl.diagnostics.survival import effective_number as effective_number
from poseppl.diagnostics.survival import survival as survival
from poseppl.diagnostics.survival import unique_ancestors as unique_ancestors
from poseppl.diagnostics.verdicts import Verdict as Verdict
from poseppl.diagnostics.verdicts import frame_ranges as frame_ranges
from poseppl.diagnostics.verdicts import verdicts as verdicts
