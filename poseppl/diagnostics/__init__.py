"""Diagnostics of a result: mixing, degeneracy, calibration, and what they mean in words."""

from poseppl.diagnostics.calibration import (
    LEVELS as LEVELS,
    Coverage as Coverage,
    coverage as coverage,
    inside_interval as inside_interval,
    probability_transform as probability_transform,
    reference_coverage as reference_coverage,
)
from poseppl.diagnostics.comparison import compare as compare, comparison_table as comparison_table
from poseppl.diagnostics.diagnosis import diagnose as diagnose
from poseppl.diagnostics.forecasts import (
    ForecastScore as ForecastScore,
    HindcastScore as HindcastScore,
    add_hindcasts as add_hindcasts,
    crps as crps,
    one_step_elpd as one_step_elpd,
    score_forecast as score_forecast,
    score_hindcasts as score_hindcasts,
)
from poseppl.diagnostics.inefficiency import (
    Mixing as Mixing,
    autocorrelation as autocorrelation,
    inefficiency as inefficiency,
    mixing as mixing,
    split_rhat as split_rhat,
    windowed_inefficiency as windowed_inefficiency,
)
from poseppl.diagnostics.parameters import check_parameters as check_parameters, predictions_under as predictions_under
from poseppl.diagnostics.predictive import (
    PredictiveFigures as PredictiveFigures,
    UpdateFigures as UpdateFigures,
    predictive_figures as predictive_figures,
    update_coverage as update_coverage,
    update_figures as update_figures,
)
from poseppl.diagnostics.simulation_based import (
    Calibration as Calibration,
    calibrate as calibrate,
    calibrate_parameters as calibrate_parameters,
)
from poseppl.diagnostics.smoothing import (
    ApproximationFigures as ApproximationFigures,
    approximation_figures as approximation_figures,
)
from poseppl.diagnostics.survival import (
    survival as survival,
    unique_ancestors as unique_ancestors,
)
from poseppl.diagnostics.unreached import UnreachedFigures as UnreachedFigures, weakly_observed_stats as weakly_observed_stats
from poseppl.diagnostics.verdicts import (
    Remedy as Remedy,
    Verdict as Verdict,
    check_intervals as check_intervals,
    check_predictions as check_predictions,
    check_unreached as check_unreached,
    check_updates as check_updates,
    frame_ranges as frame_ranges,
    verdicts as verdicts,
)
