"""The likelihood's maximum in statsmodels."""

from statsmodels.tsa.statespace.structural import UnobservedComponents

NAME, PACKAGE, METHOD, JOB = "statsmodels", "statsmodels", "`UnobservedComponents`, exact diffuse", "job_nile"


def prepare(data):
    model = UnobservedComponents(data, "local level", use_exact_diffuse=True)
    return lambda seed: model.fit(disp=False).params
