"""Figures of a result, one call each, and the report."""

from poseppl.report.compare import (
    comparison_html as comparison_html,
    write_comparison as write_comparison,
    write_comparison_table as write_comparison_table,
)
from poseppl.report.figures import (
    plot_inefficiency as plot_inefficiency,
    plot_ranks as plot_ranks,
    plot_state as plot_state,
    plot_track as plot_track,
)
from poseppl.report.picture import new_picture as new_picture, save_picture as save_picture
from poseppl.report.run_page import report_html as report_html, write_report as write_report
