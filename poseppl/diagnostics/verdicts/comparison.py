"""A comparison of runs in words: which run wins, by how much, where, and which figures should not be trusted."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from poseppl.arrays import Booleans
from poseppl.diagnostics.efficiency import RHAT_HIGH, RHAT_SHARE, disagreement
from poseppl.diagnostics.paired_comparison import QUANTITIES, TIE
from poseppl.diagnostics.replicates import NONE, evidence_words
from poseppl.diagnostics.run_figures import FORMULA
from poseppl.diagnostics.verdicts import ERROR, INFO, WARNING, Verdict
from poseppl.diagnostics.verdicts.coverage import calibration
from poseppl.diagnostics.verdicts.verdict import Findings

LEVEL = 0.9
MAX_NAMED = 8
_KINDS = {
    "wrong": Verdict(ERROR, "Wrong posterior, excluded from comparisons of ESS; coverage of 90 % intervals"),
    "over-confident": Verdict(WARNING, "Overconfident; coverage of 90 % intervals"),
    "under-confident": Verdict(WARNING, "Underconfident; coverage of 90 % intervals"),
    "calibrated": Verdict(INFO, "Calibrated; coverage of 90 % intervals"),
    "undecided": Verdict(INFO, "The sequence is too short to decide on calibration; coverage of 90 % intervals"),
}


def findings(tree: xr.DataTree) -> list[Verdict]:
    """Say what a comparison found.

    Args:
        tree: The tree of :func:`poseppl.diagnostics.compare`.

    Returns:
        The runs whose chains disagree, whose tau and ESS say little; the winners; then the problems of single runs.
    """
    checks = _agreement, _winners, _other_cameras, _evidence, _coverage, _closed_form
    return [found for check in checks for found in check(tree)]


def _evidence(tree: xr.DataTree) -> Findings:
    """The run that explains the data best, and the runs that it beats beyond Monte Carlo noise."""
    data = tree["evidence"].dataset
    names, total = data["run"].values.tolist(), data["log_evidence"].values
    known = np.isfinite(total) & np.isfinite(data["standard_error"].values)

    def words_of(mask: Booleans) -> str:
        return words([names[index] for index in np.flatnonzero(mask)])

    evidences = [f"{names[index]} {evidence_words(data.isel(run=index))}" for index in np.flatnonzero(np.isfinite(total))]
    if evidences:
        yield Verdict(INFO, f"Log evidence: {'; '.join(evidences)}.")
    if known.sum() > 1 and not any(_other_cameras(tree)):  # evidences of different data are not compared
        best = int(np.argmax(np.where(known, total, -np.inf)))
        beyond = data["beyond_noise"].values[best] & known
        behind, level = words_of(beyond), words_of(known & ~beyond & (np.arange(len(names)) != best))
        parts = [f"significantly above {behind}"] if behind else []
        parts += [f"not significantly above {level}"] if level else []
        yield Verdict(INFO, f"The log evidence of {names[best]} is the largest, {', '.join(parts)}.")
    unknown, seekers = words_of(np.isfinite(total) & ~known), words_of(data["source"].values == NONE)
    if unknown:
        yield Verdict(INFO, f"The Monte Carlo error of the log evidence of {unknown} is unknown: run three seeds or more.")
    if seekers:
        yield Verdict(INFO, f"No evidence from {seekers}: smoothers and mode-seeking filters have none.")


def words(names: list[str]) -> str:
    """Join names: "a", "a and b", "a, b and c"; those beyond the eighth are counted."""
    shown = names if len(names) <= MAX_NAMED else [*names[:MAX_NAMED], f"{len(names) - MAX_NAMED} more"]
    return " and ".join([", ".join(shown[:-1]), shown[-1]]) if len(shown) > 1 else "".join(shown)


def wins(tree: xr.DataTree, quantity: str) -> dict[str, int]:
    """How many coordinates each winner, "tie" included, has; the most first."""
    found = tree["winner_by_state_dim"].dataset["winner"].sel(quantity=quantity).values
    names, counts = np.unique(found[found != ""], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return {str(names[i]): int(counts[i]) for i in order}


def _winners(tree: xr.DataTree) -> list[Verdict]:
    data, texts = tree["winner"].dataset, []
    for quantity, best in QUANTITIES.items():
        row = data.sel(quantity=quantity)
        winner, leaders = str(row["winner"].item()), row["run"].values[row["not_worse"].values].tolist()
        if not winner:
            continue
        if winner == TIE:
            texts.append(f"The {best}: {words(leaders)} tie within the Monte Carlo error.{_where(tree, quantity)}")
        else:
            texts.append(f"{winner} has the {best}{_margin(row, winner, quantity)}.{_where(tree, quantity)}")
    nobody = "No winner: fewer than two runs have figures that can be compared."
    return [Verdict(INFO, text) for text in texts or [nobody]]


def _other_cameras(tree: xr.DataTree) -> Findings:
    """The runs that had other data of the same truth."""
    names = json.loads(tree.attrs.get("other_cameras", "[]"))
    if names:
        first = tree["figures"].dataset["run"].values[0]
        text = f"Other cameras than in {first}, but the same motion: {words(names)}."
        yield Verdict(INFO, f"{text} Errors and coverage can be compared; ESS cannot, for the posteriors differ.")


def _margin(row: xr.Dataset, winner: str, quantity: str) -> str:
    """By what factor the winner is ahead of the next."""
    ratio = row["ratio"].drop_sel(run=winner)
    if not np.isfinite(ratio.values).any():
        return ""
    after = str(ratio["run"].values[int(np.nanargmax(ratio.values))])
    found = [float(row[name].sel(run=after)) for name in ("ratio", "ratio_low", "ratio_high")]
    if quantity == "error":
        percent = [100 * value for value in found]
        return f", {percent[0]:.0f} % of that of {after} ({percent[1]:.0f} to {percent[2]:.0f} %), the second best"
    times = [1 / value for value in found]
    return f", {times[0]:.3g} times ({times[2]:.3g} to {times[1]:.3g}) that of {after}, the second best"


def _where(tree: xr.DataTree, quantity: str) -> str:
    counts = wins(tree, quantity)
    total = sum(counts.values())
    if not total:
        return ""
    parts = [f"{name} wins in {count}" for name, count in counts.items() if name != TIE]
    if list(counts) == [TIE]:
        return " No run wins a coordinate."
    if TIE in counts:
        parts.append(f"{counts[TIE]} {'are ties' if counts[TIE] > 1 else 'is a tie'}")
    return f" By coordinate ({total}): {words(parts)}."


def _coverage(tree: xr.DataTree) -> list[Verdict]:
    """The runs by what their 90 % intervals are worth, one finding a kind."""
    summary = tree["summary"].dataset.sel(level=LEVEL, method="nearest")
    kinds: dict[str, list[str]] = {kind: [] for kind in _KINDS}
    columns = (summary[name].values for name in ("run", "coverage_all", "coverage_se_all", "miscalibrated"))
    for name, share, error, out in zip(*columns, strict=True):
        if np.isfinite(share):
            kinds["wrong" if out else calibration(share, error)].append(f"{name} ({100 * share:.0f} ± {100 * error:.0f} %)")
    return [
        Verdict(_KINDS[kind].severity, f"{_KINDS[kind].finding}: {words(found)}.") for kind, found in kinds.items() if found
    ]


def _agreement(tree: xr.DataTree) -> Findings:
    """The runs whose chains disagree."""
    figures = tree["figures"].dataset
    found = []
    for name, rhat in zip(figures["run"].values, figures["rhat"].values, strict=True):
        if disagreement(rhat) > RHAT_SHARE:
            found.append(f"{name} ({100 * disagreement(rhat):.0f} %, largest {np.nanmax(rhat):.2f})")
    start = f"Chains disagree and ESS is imprecise; share of frames and coordinates with R-hat above {RHAT_HIGH}"
    if found:
        yield Verdict(WARNING, f"{start}: {words(found)}.")


def _closed_form(tree: xr.DataTree) -> Findings:
    figures = tree["figures"].dataset
    names = figures["run"].values[figures["kind"].values == FORMULA].tolist()
    if names:
        form = "are closed forms" if len(names) > 1 else "is a closed form"
        yield Verdict(INFO, f"{words(names)} {form}, without Monte Carlo error: there is no τ and no ESS.")
