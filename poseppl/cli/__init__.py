"""The command line: track, run, fit, batch, smooth, simulate, report, export, compare, reproduce, and others; and lists.

Nothing heavy is imported before a command runs, so that help is quick.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections import Counter
from collections.abc import Sequence
from io import StringIO, TextIOWrapper
from pathlib import Path

import click

from poseppl import small_loops
from poseppl.cli.batch import batch as batch_command, keypoints as trials_command
from poseppl.cli.calibrate_detector import calibrate_detector as calibrate_detector_command
from poseppl.cli.compare import compare as compare_command
from poseppl.cli.demo import demo as demo_command
from poseppl.cli.doctor import doctor as doctor_command
from poseppl.cli.export import export as export_command
from poseppl.cli.fit import fit as fit_command
from poseppl.cli.gait import fit_gait as fit_gait_command, gait as gait_command
from poseppl.cli.motion import fit_motion as motion_command
from poseppl.cli.options import as_options
from poseppl.cli.overlay import overlay as overlay_command
from poseppl.cli.report import report as report_command
from poseppl.cli.reproduce import reproduce as reproduce_command
from poseppl.cli.run import run as run_command
from poseppl.cli.settings import (
    filters as filters_command,
    methods as methods_command,
    smoothers as smoothers_command,
)
from poseppl.cli.signals import end_by_signal, signal_of, signals_interrupt
from poseppl.cli.simulate import simulate as simulate_command
from poseppl.cli.smooth import smooth as smooth_command
from poseppl.cli.track import track as track_command
from poseppl.errors import MAX_SHOWN, PosepplError, cut
from poseppl.files.atomic_writing import files_written
from poseppl.files.cache_folder import ensure_home

_FATAL = "3"
"""Level of XLA's log on stderr. Failures are also exceptions; other errors there only report long compilations."""
_NAMED = 5
"""Files of a folder that a message names."""

EPILOG = """\b
Exit status:
  0    all went well
  1    bad input, an output that cannot be written, or a run that cannot go on
  2    wrong usage: an unknown option or command, or a value of the wrong kind
  130  interrupted by Ctrl-C; 143 and 129 by the signals TERM and HUP, which end a command as Ctrl-C does
"""


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=EPILOG
    + """
\b
Examples:
  poseppl track                              a built-in walk, seen by one camera
  poseppl track 02_01.amc --skeleton 02.asf  a recorded walk
  poseppl run model.py --data series.csv     your own model on your own data
  poseppl fit model.py --data series.csv     its parameters, with standard errors
  poseppl smooth poseppl-02_01.nc            every frame given all frames
  poseppl filters                            the algorithms of track --filter, and their settings
  poseppl report poseppl-02_01.nc            its report, one HTML file
  poseppl export poseppl-02_01.nc            joints and angles for OpenSim, with intervals
  poseppl gait poseppl-cam1-laplace.nc       steps and joint angles of a walk, with intervals
  poseppl overlay poseppl-02_01.nc cam1.mp4   skeletons over a video
  poseppl compare hmc.nc particle.nc         two results on the same data, one HTML file
  poseppl track keypoints --help             the options of a source
  poseppl demo walk                          a recording of four cameras to try it with
  poseppl doctor                             what is installed, and what is missing
""",
)
@click.version_option(package_name="poseppl", message="poseppl %(version)s")
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
def cli() -> None:
    """Track people in 2-D images by sequential Bayesian inference, with calibrated intervals."""
    if "jax" not in sys.modules:
        small_loops.as_functions()
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", _FATAL)


batch_command.add_command(trials_command)
for command in (
    track_command,
    run_command,
    batch_command,
    smooth_command,
    filters_command,
    smoothers_command,
    fit_command,
    methods_command,
    simulate_command,
    demo_command,
    report_command,
    export_command,
    overlay_command,
    compare_command,
    reproduce_command,
    fit_gait_command,
    gait_command,
    motion_command,
    calibrate_detector_command,
    doctor_command,
):
    cli.add_command(command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: The arguments; the process's own if None.

    Returns:
        The exit status.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug, written = "--debug" in given, list[Path]()
    given = [word for word in given if word != "--debug"]  # it may stand anywhere
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files need not be text
    ensure_home()
    try:
        with signals_interrupt(), files_written() as written:
            status = cli.main(given, prog_name="poseppl", standalone_mode=False)
        return status if isinstance(status, int) else 0
    except click.ClickException as error:
        error.show(shown := StringIO())
        print(cut(shown.getvalue()).rstrip("\n"), file=sys.stderr, flush=True)
        return error.exit_code
    except (KeyboardInterrupt, click.Abort) as error:
        _say(f"interrupted; {_told(written)}", debug)
        end_by_signal(number := signal_of(error))
        return 128 + number
    except PosepplError as error:
        _say(as_options(error), debug)
    except BrokenPipeError:
        sys.stderr.close()
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _say(f"{where}{error.strerror or error}", debug)
    except MemoryError:
        _say("out of memory; try fewer particles, chains, draws or frames", debug)
    except Exception as error:  # our fault: still one message, and how to see more
        _say(f"unexpected {type(error).__name__}: {_first_line(error)} (--debug shows where)", debug)
    return 1


def _say(message: str, debug: bool) -> None:
    if debug:
        traceback.print_exc()
    print(f"poseppl: {cut(message, MAX_SHOWN)}", file=sys.stderr, flush=True)


def _told(written: Sequence[Path]) -> str:
    """Which files a command has written, those of a folder by their number if there are many."""
    folders = Counter(path.parent for path in written)
    names = [str(path) for path in written if folders[path.parent] <= _NAMED]
    names += [f"{number} files in {folder}" for folder, number in folders.items() if number > _NAMED]
    return f"written, each whole: {', '.join(names)}" if names else "no file was written"


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else ""
