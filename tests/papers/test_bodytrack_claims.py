"""The bodytrack benchmark as an experiment: its figures against ours, by hand, and recordings that are folders."""

from __future__ import annotations

import pytest
from poseppl_papers.bodytrack import EXPERIMENT
from poseppl_papers.bodytrack.experiment import CROSSED, PLAIN, claims, method_of
from poseppl_papers.experiment import on_one_recording
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.tables import Table

from poseppl.errors import InputError


def estimates(**means: float) -> dict[str, Table]:
    rows = [(method, 5000, 10, mean, 0.002, mean, 0.002) for method, mean in means.items()]
    return {"estimates": Table("estimates", ("method", "evaluations", "runs", "mean", "mean_sd", "best", "best_sd"), rows)}


@pytest.mark.parametrize(
    ("mean", "verdict"),
    [(-0.2962, "holds"), (-0.2972, "undecided"), (-0.2985, "undecided"), (-0.3005, "does not hold"), (-0.29, "holds")],
)
def test_an_estimate_is_as_good_that_is_worse_by_less_than_matters(mean, verdict):
    """Both have standard errors of 0.0006, their difference one of 0.0009; what matters is 0.0010."""
    found = claims(estimates(**{"annealed, 5 x 1,000": mean}))
    assert [claim.verdict for claim in found] == [on_one_recording(verdict)]


@pytest.mark.parametrize(
    ("crossed", "verdict"), [(-0.28, "holds"), (-0.2885, "undecided"), (-0.29, "undecided"), (-0.3, "does not hold")]
)
def test_crossing_limbs_has_to_gain_by_what_matters(crossed, verdict):
    """A gain of 0.0025 is above 0 by two standard errors of 0.0009, but not above 0.0010."""
    assert claims(estimates(**{CROSSED: crossed, PLAIN: -0.291}))[0].verdict == on_one_recording(verdict)


@pytest.mark.parametrize(("score", "verdict"), [(-0.30684, "holds"), (-0.3069, "does not hold")])
def test_scores_agree_to_their_digits(score, verdict):
    table = Table("poses", ("figure", "value"), [("score of the initial pose", score)])
    assert [claim.verdict for claim in claims({"poses": table})] == [verdict]


def test_methods_are_what_their_names_say():
    assert dict(method_of("annealed, 5 x 4,000").settings) == {"num_layers": 5, "num_particles": 4000}
    assert dict(method_of(CROSSED).settings) == {"num_layers": 20, "num_particles": 250, "crossover": "limbs"}


@pytest.mark.full
def test_a_folder_is_known_by_all_of_its_files(tmp_path):
    (tmp_path / "CAM1").mkdir()
    (tmp_path / "CAM1" / "image.bmp").write_bytes(b"a")
    first = Recording.of_file("one", tmp_path)
    (tmp_path / "CAM1" / "image.bmp").write_bytes(b"b")
    assert Recording.of_file("one", tmp_path).digest != first.digest and first.path == str(tmp_path)


@pytest.mark.full
def test_it_needs_its_recording():
    for part in EXPERIMENT.parts.values():
        with pytest.raises(InputError, match="sequenceB_1=FOLDER"):
            part.plan(EXPERIMENT.quick, [BUILT_IN])
