"""Build the site and check it: ``python docs/website [OUTPUT]``; ``--help`` tells the rest."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[0] = str(HERE.parent)
sys.path[1:1] = [str(ROOT), str(ROOT / "models"), str(ROOT / "papers")]
os.environ.setdefault("MPLBACKEND", "Agg")

from sphinx.cmd.build import build_main  # noqa: E402

from website.check import faults  # noqa: E402
from website.tree import assemble  # noqa: E402


def main() -> int:
    """Build and check."""
    parser = argparse.ArgumentParser(prog="python docs/website", description="Build the site, without network, and check it.")
    parser.add_argument("output", nargs="?", default=ROOT / "build" / "site", type=Path, help="the site's folder")
    parser.add_argument("--notebooks", choices=("cache", "force", "off"), default="cache", help="when notebooks are executed")
    given = parser.parse_args()
    work = given.output.resolve().parent
    source = work / "site-source"
    os.environ |= {"POSEPPL_SITE_NOTEBOOKS": given.notebooks, "POSEPPL_SITE_CACHE": str(work / "site-notebooks")}
    os.environ["PYTHONPATH"] = os.pathsep.join(
        [str(ROOT), str(ROOT / "models"), str(ROOT / "papers"), os.environ.get("PYTHONPATH", "")]
    )
    assemble(source)
    shutil.rmtree(given.output / "_modules", ignore_errors=True)  # Sphinx keeps sources whose links have changed
    options = ["-c", str(HERE), "-d", str(work / "site-doctrees"), "--fail-on-warning", "--keep-going", "--quiet"]
    if build_main([*options, str(source), str(given.output)]):
        return 1
    for page in (given.output / "reference").glob("*.html"):  # Sphinx keeps those of modules that are no more
        if not (source / "reference" / f"{page.stem}.rst").exists():
            page.unlink()
    wrong = faults(given.output)
    for fault in wrong:
        print(fault, file=sys.stderr)
    print(f"{given.output}: {len(list(given.output.rglob('*.html')))} pages, {len(wrong)} faults")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
