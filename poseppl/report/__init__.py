"""Figures of a result, one call each, and the report."""

from poseppl.report.compare import comparison_html as comparison_html
from poseppl.report.compare import write_comparison as write_comparison
from poseppl.report.compare import write_comparison_table as write_comparison_table
from poseppl.report.figures import plot_autocorrelation as plot_autocorrelation
from poseppl.report.figures import plot_error as plot_error
from poseppl.report.figures import plot_inefficiency as plot_inefficiency
from poseppl.report.figures import plot_overlay as plot_overlay
from poseppl.report.figures import plot_pose3d as plot_pose3d
from poseppl.report.figures import plot_state as plot_state
from poseppl.report.figures import plot_trace as plot_trace
from poseppl.report.figures import plot_track as plot_track
from poseppl.report.picture import new_picture as new_picture
from poseppl.report.picture import save_picture as save_picture
from poseppl.report.run_page import report_html as report_html
from poseppl.report.run_page import write_report as write_report
