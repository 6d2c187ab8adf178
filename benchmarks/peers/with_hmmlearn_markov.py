"""The job of hidden states in hmmlearn: expectation maximisation, with priors that say nothing."""

import numpy as np
from hmmlearn.hmm import GaussianHMM
from job_markov import START

NAME, PACKAGE, METHOD, JOB = "hmmlearn", "hmmlearn", "expectation maximisation", "job_markov"


def prepare(data):
    def run(seed):
        model = GaussianHMM(
            2, init_params="", params="tmc", covars_prior=0.0, covars_weight=1.0, min_covar=0.0, n_iter=500, tol=1e-6
        )
        model.startprob_ = np.array([0.5, 0.5])
        model.transmat_ = np.array([[START[0], 1 - START[0]], [1 - START[1], START[1]]])
        model.means_, model.covars_ = START[2:4, None], START[4:, None] ** 2
        model.fit(data[:, None])
        return np.concatenate([np.diag(model.transmat_), model.means_[:, 0], np.sqrt(model.covars_[:, 0, 0])])

    return run
